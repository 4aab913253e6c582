"""A session whose plant and law run in processes of their own, because the scenario names a program.

It is a run of `hil run` that is held before its next step, driven by the socket of its session. The interface is that
of the native session; what needs both sides in this process is refused.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import time
import weakref
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

from . import folders
from .errors import CommandError, InfrastructureError, SessionError, of_exit_code
from .native import native
from .programs import cannot_start, environment, find, parsed, succeed
from .result import Run

#: Socket in the folder of a session.
SOCKET = "control"
#: A request must be answered within this time; `hil` itself waits shorter.
ANSWER_LIMIT_S = 20.0
#: After Ctrl-C the present step must end within this time, or the run is ended.
HOLD_LIMIT_S = 1.0
#: Steps are requested in parts of about this duration, between which Python takes its signals.
PART_S = 0.1
LOOK_S = 0.005
#: An interrupted run must end within this time, which is beyond the limits of `hil` itself; else it is killed.
END_LIMIT_S = 60.0
#: Files in the folder with what `hil` prints; a pipe that is full would stop it.
OUTPUT, MESSAGES = "output", "messages"
PR_SET_PDEATHSIG = 1


class RemoteSession:
    """A held run in two processes, with the interface of the native session."""

    def __init__(self, path: str, flags: Sequence[str]) -> None:
        self._folder, lock = folders.create()
        self._name = f"py-{os.getpid()}-{os.urandom(4).hex()}"
        out = os.path.join(self._folder, "run")
        command = [find(), "run", "--json", "--pause-at=0", f"--session={self._name}", f"--out={out}"]
        command += [f"--set={flag}" for flag in flags]
        try:
            # Ctrl-C at the terminal is for Python alone, which ends the run when it ends.
            with open(self._file(OUTPUT), "xb") as output, open(self._file(MESSAGES), "xb") as messages:
                self._process = subprocess.Popen(
                    [*command, "--", path],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=messages,
                    env=environment(),
                    start_new_session=True,
                    pass_fds=(lock,),  # in use until they have ended, too
                    preexec_fn=_dying_with(os.getpid()),
                )
        except OSError as error:
            folders.remove(self._folder, lock)
            raise cannot_start(command[0], error) from error
        self._end = weakref.finalize(self, _end, self._process, self._folder, lock, os.getpid())
        self._owner = os.getpid()
        self._command = command
        self._run: Optional[Run] = None
        self._failure: Optional[CommandError] = None
        self._is_closed = False
        self._part = 64
        try:
            self._socket = self._find_socket()
            self._possible = self._ask({"request": "possible"})
            self._status = self._ask({"request": "status"})
        except BaseException:
            self.close()
            raise

    def _find_socket(self) -> str:
        """Waits until the plant listens; `hil` bounds that wait."""
        path: Optional[str] = None
        while True:
            if self._process.poll() is not None:
                self._conclude()
            if path is None:
                sessions = parsed(succeed(["sessions", "--json"]))["sessions"]
                own = [one["folder"] for one in sessions if one["name"] == self._name]
                path = os.path.join(own[0], SOCKET) if own else None
            elif _listens(path):
                return path
            time.sleep(LOOK_S)

    def _ask(self, request: Dict[str, Any], limit_s: float = ANSWER_LIMIT_S) -> Dict[str, Any]:
        with socket.socket(socket.AF_UNIX) as stream:
            stream.settimeout(limit_s)
            try:
                stream.connect(self._socket)
                stream.sendall(json.dumps(request).encode() + b"\n")
                with stream.makefile("rb") as answers:
                    answer = answers.readline()
            except OSError as error:
                answer, reason = b"", str(error)
            else:
                reason = "it closed the connection"
        if answer:
            parsed_answer: Dict[str, Any] = json.loads(answer)
            return parsed_answer
        if self._has_ended(limit_s):
            self._conclude()
            return {"response": "refused", "problems": [{"key": "", "message": "the run is over"}]}
        raise InfrastructureError(self._command, 3, f"error: the plant of session `{self._name}` does not answer: {reason}")

    def _has_ended(self, limit_s: float) -> bool:
        """Waits for the end of a process whose plant has closed its socket."""
        try:
            self._process.wait(limit_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def _conclude(self) -> None:
        """Reads the results of the run, whose process has ended. Raises its failure, which also has results."""
        if self._run is None and self._failure is None:
            facts = parsed(self._printed(OUTPUT))
            is_summary = isinstance(facts, dict) and "session" in facts
            self._run = Run(Path(self._folder) / "run") if is_summary else None
            code = self._process.returncode
            if self._run is None or code not in (0, 1):
                problems = facts.get("problems", []) if isinstance(facts, dict) else []
                text = self._lasting(self._printed(MESSAGES))
                self._failure = of_exit_code(code)(self._command, code, text, problems, self._run)
        if self._failure is not None:
            raise self._failure

    def _file(self, name: str) -> str:
        return os.path.join(self._folder, name)

    def _printed(self, name: str) -> str:
        return Path(self._file(name)).read_text(errors="replace")

    def _lasting(self, text: str) -> str:
        """Returns a text of `hil` without what is of no use later: the folder of the run, and how to resume it."""
        lines = text.replace(os.path.join(self._folder, "run", ""), "").splitlines(keepends=True)
        return "".join(line for line in lines if not line.startswith("paused at step "))

    def _check(self) -> None:
        if os.getpid() != self._owner:
            raise SessionError("this session was opened before a fork, by the parent process; open another one in this process")
        if self._is_closed:
            raise SessionError("this session is closed; open another one")

    # The interface of the native session.

    def step(self, steps: int = 1) -> None:
        self._check()
        if steps < 0:
            raise OverflowError("can't convert negative int to unsigned")
        if self.is_over:
            raise SessionError(f"the run is over since step {self.step_index}; open another session")
        self._advance(self._status["step"] + steps)

    def step_to(self, time_s: float) -> None:
        self._check()
        step = self.step_index
        if not time_s >= 0:
            raise SessionError(f"{time_s} is no simulated time")
        if time_s == float("inf"):
            target = self._status["steps"]
        else:
            target = _step_at_or_after(time_s, self.length[1])
        if target < step and not (self.is_over and target >= self._status["steps"]):
            raise SessionError(f"{time_s} s is past, because the next step is {step} ({self.time_s} s)")
        if not self.is_over:
            self._advance(target)

    def _advance(self, target: int) -> None:
        try:
            if target >= self._status["steps"]:
                self._ask({"request": "resume"})
                while self._process.poll() is None:
                    time.sleep(LOOK_S)
                self._conclude()
            else:
                self._advance_in_parts(target)
        except KeyboardInterrupt:
            self._hold()
            raise

    def _hold(self) -> None:
        """Holds the run, so that the session goes on from there; ends it if a side hangs."""
        deadline = time.monotonic() + HOLD_LIMIT_S
        try:
            self._ask({"request": "pause"}, HOLD_LIMIT_S)
            while not self._look(HOLD_LIMIT_S):
                if time.monotonic() > deadline:
                    break
                time.sleep(LOOK_S)
            else:
                return
        except CommandError:
            pass  # what was asked for is the interruption
        _interrupt(self._process)
        try:
            self._conclude()
        except CommandError:
            pass

    def _advance_in_parts(self, target: int) -> None:
        while not self.is_over and self._status["step"] < target:
            part = min(self._part, target - self._status["step"])
            since = time.monotonic()
            answer = self._ask({"request": "advance", "steps": part})
            if answer["response"] == "refused":
                time.sleep(LOOK_S)  # the run is about to end early
                continue
            self._status = answer
            took_s = time.monotonic() - since
            self._part = max(1, min(2 * self._part, int(self._part * PART_S / max(took_s, 1e-4))))
            if not answer["paused"]:
                self._wait_until_held()

    def _wait_until_held(self) -> None:
        while not self._look(ANSWER_LIMIT_S):
            time.sleep(LOOK_S)

    def _look(self, limit_s: float) -> bool:
        """Asks for the status; returns `True` if the run is held or over."""
        answer = self._ask({"request": "status"}, limit_s)
        if answer["response"] != "refused":
            self._status = answer
        return self.is_over or bool(answer.get("paused"))

    def request(self, request: str) -> str:
        self._check()
        return json.dumps(self._ask(json.loads(request)))

    def value(self, name: str) -> Optional[float]:
        self._check()
        values = self._values()
        return values.get(name)

    def _values(self) -> Mapping[str, float]:
        if self.is_over:
            raise SessionError("the run is over; its values are in the recording of a run of scenario()")
        return {name: value for name, _, value in self._record() or ()}

    def _record(self) -> Optional[List[Tuple[str, str, float]]]:
        """Returns name, unit and value of each signal of the newest step; `None` before the first."""
        answer = self._ask({"request": "record"})
        signals: Optional[List[Tuple[str, str, float]]] = native().record_signals(json.dumps(answer))
        return signals

    def observe(self, names: List[str]) -> Any:
        self._check()
        known = dict(self.signals()[0])
        for name in names:
            if name not in known:
                return name
        observer = RemoteObserver(names)
        self.copy(observer)
        return observer

    def copy(self, observer: RemoteObserver) -> None:
        self._check()
        values = self._values()
        row = [values.get(name, float("nan")) for name in observer.names]
        struct.pack_into(f"={len(row)}d", observer.memory, 0, *row)

    def save(self) -> Any:
        raise SessionError("a session in two processes is saved by checkpoints: `hil run --checkpoint-at`, and `--from`")

    def restore(self, saved: object) -> None:
        self.save()

    def reset(self, seed: Optional[int] = None) -> None:
        raise SessionError("a session in two processes cannot begin again; open another one")

    def close(self) -> None:
        if os.getpid() != self._owner:
            self._check()
        self._is_closed = True
        self._end()

    def signals(self) -> Tuple[List[Tuple[str, str]], List[Tuple[str, str]]]:
        self._check()
        possible = self._possible
        plant = possible["plant"]
        groups = {
            "truth": plant["truth"],
            "measured": plant["measured"],
            "reference": possible["reference"],
            "command": plant["commands"],
            "applied": plant["commands"],
        }
        record = None if self.is_over else self._record()
        if record is not None:
            return [(name, unit) for name, unit, _ in record], []
        pairs = [(f"{group}.{field['name']}", field["unit"]) for group, fields in groups.items() for field in fields]
        return pairs, []

    @property
    def step_index(self) -> int:
        self._check()
        if self._run is not None and self._run.summary is not None:
            return int(self._run.summary["steps"])
        return int(self._status["step"])

    @property
    def time_s(self) -> float:
        return self.step_index / self.length[1]

    @property
    def length(self) -> Tuple[int, float]:
        self._check()
        return int(self._status["steps"]), float(self._possible["rate"])

    @property
    def is_over(self) -> bool:
        self._check()
        return self._run is not None or self._failure is not None

    def _result(self) -> Run:
        self._check()
        if self._run is None and self._failure is not None:
            raise SessionError(f"the run ended without results: {self._failure}")
        if self._run is None:
            raise SessionError("a session in two processes has its results after its end; step_to() executes the rest")
        return self._run

    @property
    def digest(self) -> Optional[str]:
        return self._result().digest

    def results(self) -> str:
        summary = self._result().summary or {}
        end = {"verdict": summary.get("verdict"), "reason": summary.get("reason")}
        return json.dumps({"requirements": summary["requirements"], "metrics": summary["metrics"], "end": end})

    def scenario(self) -> str:
        return succeed(["scenario", "from", str(self._result().folder)])


class RemoteObserver:
    """Names of values, and the memory for them."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = list(names)
        self.memory = bytearray(8 * len(self.names))


def _listens(path: str) -> bool:
    """Returns `True` if a process accepts connections at a socket, whose file exists a moment earlier."""
    with socket.socket(socket.AF_UNIX) as stream:
        try:
            stream.connect(path)
        except (FileNotFoundError, ConnectionRefusedError):
            return False
    return True


def _step_at_or_after(time_s: float, rate_hz: float) -> int:
    """Returns the first step at or after a time."""
    step = int(time_s * rate_hz)
    while step > 0 and (step - 1) / rate_hz >= time_s:
        step -= 1
    while step / rate_hz < time_s:
        step += 1
    return step


def _dying_with(parent: int) -> Any:
    """Returns a function for the child, which then gets SIGTERM when the thread that started it ends."""
    import ctypes

    prctl = ctypes.CDLL(None, use_errno=True).prctl

    def die_with_parent() -> None:
        prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:
            os._exit(3)  # it has ended meanwhile

    return die_with_parent


def _end(process: subprocess.Popen[bytes], folder: str, lock: int, owner: int) -> None:
    """Ends the run and removes its folder."""
    if os.getpid() != owner:
        return
    _interrupt(process)
    folders.remove(folder, lock)


def _interrupt(process: subprocess.Popen[bytes]) -> None:
    """Ends the run, which cleans up after itself, and kills it if it does not."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(END_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
