"""Environments of Gymnasium: a scenario that an agent acts on, step by step.

    import hil.gym

    env = hil.gym.Env(
        "scenarios/spring-mass.toml",
        observe=["measured.position_m", "reference.position_m"],
        act={"command.force_n": (-5, 5)},
        reward="settles",
    )

It needs `gymnasium`, which the package does not require.
"""

from __future__ import annotations

import math
import os
from functools import partial
from multiprocessing.connection import wait
from numbers import Real
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from .errors import ProgramError, SessionError, UnknownSignal, end_in_words
from .native import native
from .session import Session

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ProgramError("hil.gym needs the package gymnasium: pip install gymnasium") from error
import numpy as np
from gymnasium.vector.async_vector_env import _async_worker
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .session import Location

Values = NDArray[np.float64]
Limits = Tuple[float, float]
Reward = Union[str, Callable[[Session], float]]

#: What `act` names that is no command: changed as by `hil set`.
_TUNED = ("reference.", "controller.", "plant.", "inputs.")
#: Number of values that a generator of numpy can give and `run.seed` can take.
_SEEDS = 2**31
#: A process whose pipe has ended is over within this time.
_END_LIMIT_S = 5.0


class Env(gymnasium.Env[Values, Values]):
    """A scenario as an environment, whose plant runs in this process.

    `observe` lists signals; `act` the values that the agent chooses, each with its limits: commands, in place of those
    of the law, or anything that `hil set` changes, such as `reference.position_m`. A list without limits takes the
    ranges that plant and law declare.

    `reward` is the name of a signal, whose value is the reward; the name of a requirement, whose robustness is the
    return of an episode, because each reward is what a step added to it; `-` before a name turns its sign, for an agent
    that looks for failures; or a function of the session.

    An episode is terminated once a requirement is certain to fail, all are certain to pass, or the run diverged, and
    truncated at the end of the run.
    """

    metadata: Dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        scenario: Location,
        *,
        observe: Sequence[str],
        act: Union[Sequence[str], Mapping[str, Limits]],
        reward: Reward,
        steps_per_action: int = 1,
        set: Optional[Mapping[str, object]] = None,
        plant: Optional[type] = None,
        law: Optional[type] = None,
    ) -> None:
        if not isinstance(steps_per_action, int) or steps_per_action < 1:
            raise SessionError(f"steps_per_action is {steps_per_action!r}; an action takes one step or several")
        act = [act] if isinstance(act, str) else act
        names = list(act)
        if not names:
            raise SessionError("act is empty; name at least one value that the agent chooses")
        commands = [name for name in names if name.startswith("command.")]
        tuned = [name for name in names if name not in commands]
        values = dict(set or {})
        self._agent: Any = None
        chosen: Any = law
        if commands:
            if law is not None or "controller.law" in values:
                raise SessionError("an agent that chooses commands takes the place of the law, so none can be chosen")
            chosen = self._agent = native().Agent()
            values["controller.law"] = "agent"
        #: The session, for its signals; its steps are those of the environment.
        self.session = Session(scenario, set=values, plant=plant, law=chosen)
        session: Any = self.session._native
        if not isinstance(session, native().Session):
            self.session.close()
            raise SessionError(f"{os.fspath(scenario)} names a program; an environment has its plant in this process")
        try:
            self._steps = steps_per_action
            self._native, self._play = session, native().play
            self._observation = self.session.observe(observe)
            self._observer = self._observation._native
            self._set_reward(reward)
            self._set_actions(names, commands, tuned, act if isinstance(act, Mapping) else {})
            self._refuse_too_many_changes(tuned)
        except BaseException:
            self.session.close()
            raise
        shape = (len(self._observation.names),)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float64)
        self._robustness = 0.0
        self._is_over = True

    def _set_reward(self, reward: Reward) -> None:
        self._sign, self._requirement = 1.0, None
        self._reward: Optional[Callable[[Session], float]] = None
        if callable(reward):
            self._reward = reward
            self._reward_name = f"function `{getattr(reward, '__qualname__', type(reward).__name__)}`"
            return
        if not isinstance(reward, str):
            raise SessionError(f"reward is {reward!r}; use the name of a requirement or a signal, or a function")
        name = reward[1:] if reward.startswith("-") else reward
        self._sign = -1.0 if reward.startswith("-") else 1.0
        requirements = list(self.session.verdicts)
        if name in requirements:
            self._requirement = requirements.index(name)
        elif name in self.session:
            self._reward = lambda session: session[name]
            self._reward_name = f"signal `{name}`"
        else:
            known = [*requirements, *self.session.signals, *self.session.derived]
            raise UnknownSignal(name, self.session._path, known, owner="session")

    def _set_actions(
        self, names: List[str], commands: List[str], tuned: List[str], limits: Mapping[str, Limits]
    ) -> None:
        ranges = self._ranges(tuned)
        for name in names:
            if name not in ranges:
                raise UnknownSignal(name, self.session._path, [*ranges, *self.session.tunable], owner="session")
        low, high = [], []
        for name in names:
            least, most = _limits(name, limits.get(name, ranges[name]))
            if not least < most:
                raise SessionError(f"the limits of `{name}` are {least} to {most}; the first must be below the second")
            if not (ranges[name][0] <= least and most <= ranges[name][1]):
                raise SessionError(f"the limits of `{name}` are {least} to {most}; they must be within {ranges[name]}")
            if not math.isfinite(most - least):
                raise SessionError(f"`{name}` has no range; give its limits, as in act={{{name!r}: (-1.0, 1.0)}}")
            low.append(least)
            high.append(most)
        self._low, self._high = np.array(low, np.float64), np.array(high, np.float64)
        self.action_space = gymnasium.spaces.Box(self._low, self._high, dtype=np.float64)
        # The place of each action among the commands or the changed values.
        self._tuned = [(names.index(name), name) for name in tuned]
        self._places = np.array([names.index(name) for name in commands], np.intp)
        if self._agent is not None:
            order = [name for name in self.session.signals if name.startswith("command.")]
            self._commands = np.array([order.index(name) for name in commands], np.intp)
            self._memory = self._agent.memory()
            self._chosen = np.frombuffer(self._memory, np.float64)
            self._start = self._chosen.copy()

    def _refuse_too_many_changes(self, tuned: Sequence[str]) -> None:
        """Refuses actions of which an episode could have more than a run takes."""
        limit, steps = int(native().MOST_CHANGES), self.session.steps
        if tuned and steps > limit * self._steps:
            raise SessionError(
                f"an episode has up to {steps} steps, and a run takes {limit} changes, which actions such as "
                f"`{tuned[0]}` are; use steps_per_action={-(-steps // limit)} or more"
            )

    def _ranges(self, tuned: Sequence[str]) -> Dict[str, Limits]:
        """Returns the range of each command and of everything that can be changed."""
        ranges = {f"command.{name}": (least, most) for name, least, most in self.session._native.commands()}
        if tuned:
            values = self.session.tunable.items()
            ranges.update((key, (one["min"], one["max"])) for key, one in values)
        return ranges

    def reset(
        self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None
    ) -> Tuple[Values, Dict[str, Any]]:
        """Begins an episode, and executes step 0 with the start values of the commands.

        `seed` is the value of `run.seed` in the scenario, and repeats an episode; without one, each episode has another
        seed. There are no options.
        """
        super().reset(seed=seed)
        if options:
            raise SessionError(f"an environment of hil has no options, such as {next(iter(options))!r}")
        self.session.reset(int(self.np_random.integers(_SEEDS)) if seed is None else seed)
        if self._agent is not None:
            self._chosen[:] = self._start
            self._agent.choose(self._memory)
        self._changed = [float("nan")] * len(self._tuned)
        self._is_over, _, self._robustness = self._play(self._native, self._observer, 1, self._requirement)
        return self._observation.values.copy(), {}

    def step(self, action: Values) -> Tuple[Values, float, bool, bool, Dict[str, Any]]:
        """Executes the steps of one action, whose values are clipped to their limits."""
        if self._is_over:
            raise SessionError("the episode is over, or none has begun; reset() begins one")
        action = np.asarray(action, np.float64)
        if action.shape != self._low.shape:
            raise ValueError(f"the action has shape {action.shape}; expected {self._low.shape}")
        action = np.minimum(np.maximum(action, self._low), self._high)
        if not (action == action).all():
            raise ValueError(f"the action has a value that is no number: {action}")
        if self._agent is not None:
            self._chosen[self._commands] = action[self._places]
            self._agent.choose(self._memory)
        if self._tuned:
            self._change(action)
        is_over, certain, robustness = self._play(self._native, self._observer, self._steps, self._requirement)
        if self._reward is not None:
            reward = self._sign * self._checked(self._reward(self.session))
        else:
            # Infinite if a missing value decided the requirement.
            added = 0.0 if robustness == self._robustness else robustness - self._robustness
            reward, self._robustness = self._sign * added, robustness
        diverged = is_over and self.session.step_index < self.session.steps
        terminated = diverged or (certain is not None and not is_over)
        self._is_over = is_over or terminated
        info = self._end(certain) if self._is_over else {}
        return self._observation.values.copy(), reward, terminated, is_over and not diverged, info

    def _checked(self, reward: object) -> float:
        """Returns a reward as a number."""
        if isinstance(reward, Real) and not math.isnan(reward):
            return float(reward)
        at = self.session.step_index - 1
        raise SessionError(f"the reward by the {self._reward_name} is {reward!r} at step {at}; it must be a number")

    def _change(self, action: Values) -> None:
        values = [float(action[place]) for place, _ in self._tuned]
        if values != self._changed:
            self._changed = values
            self.session.set({name: value for (_, name), value in zip(self._tuned, values)})

    def _end(self, certain: Optional[bool]) -> Dict[str, Any]:
        """Returns what is known at the end of an episode."""
        result = self.session.result()
        verdict = result.verdict or ("pass" if certain else "fail")
        return {"verdict": verdict, "reason": result.reason, "digest": result.digest}

    def close(self) -> None:
        """Ends the session."""
        self.session.close()


def _limits(name: str, limits: Any) -> Limits:
    try:
        least, most = limits
        return float(least), float(most)
    except (TypeError, ValueError):
        raise SessionError(f"the limits of `{name}` are {limits!r}; use two numbers") from None


class _Pipe:
    """Pipe to the process of an environment, whose end is a clear exception."""

    def __init__(self, vector: _Vector, pipe: Any) -> None:
        self._vector, self._pipe = vector, pipe

    def __getattr__(self, name: str) -> Any:
        return getattr(self._pipe, name)

    def send(self, message: object) -> None:
        try:
            self._pipe.send(message)
        except OSError as error:
            raise self._vector.lost() from error

    def recv(self) -> Any:
        try:
            return self._pipe.recv()
        except (EOFError, OSError) as error:
            raise self._vector.lost() from error


def _work(*arguments: Any) -> None:
    """Is the process of an environment, and ends quietly with the process that started it."""
    try:
        _async_worker(*arguments)
    except (EOFError, ConnectionError):
        # It was reported where the environments were made, or nobody is left to whom it could be.
        pass


class _Vector(gymnasium.vector.AsyncVectorEnv):
    """Environments in processes, which all end if one of them is lost."""

    def __init__(self, count: int, make: Callable[[], Env]) -> None:
        self.processes: List[Any] = []
        try:
            super().__init__([make] * count, context="spawn", worker=_work)
        except (EOFError, OSError) as error:
            if not self.processes:
                raise
            raise self.lost() from error
        self.parent_pipes = [_Pipe(self, pipe) for pipe in self.parent_pipes]  # type: ignore[misc]

    def lost(self) -> SessionError:
        """Ends all environments; returns the exception that says which of them was lost."""
        ended = wait([process.sentinel for process in self.processes], _END_LIMIT_S)
        for process in self.processes:
            if process.sentinel in ended:
                process.join(_END_LIMIT_S)
        codes = [process.exitcode for process in self.processes]
        ends = [f"environment {place} {end_in_words(code)}" for place, code in enumerate(codes) if code is not None]
        for process in self.processes:
            process.kill()
            process.join()
        for pipe in self.parent_pipes:
            pipe.close()
        self.closed = True
        return SessionError(f"{'; '.join(ends)}; all environments have ended, so make new ones")


def make_vector(count: int, scenario: Location, **arguments: Any) -> gymnasium.vector.AsyncVectorEnv:
    """Returns environments with these arguments, each in a process of its own; `close()` ends them.

    The processes are started anew and not forked, so a script needs `if __name__ == "__main__":` around its work. If one
    of them is lost, all end, and a `SessionError` says which it was.
    """
    if count < 1:
        raise SessionError(f"count is {count}; there is at least one environment")
    return _Vector(count, partial(Env, scenario, **arguments))
