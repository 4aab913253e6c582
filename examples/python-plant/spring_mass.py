"""The teaching plant and its PID loop, once more, in Python: a mass on a spring with a damper.

Both have the names and equations of those that ship with `hil`, and so their digest: `hil run spring-mass.toml`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Tuple

import hil
from hil.math import integrate


@dataclass
class Parameters:
    """Parameters of the plant."""

    mass_kg: float = hil.parameter(1.0, unit="kg", min=1e-6, max=1e9, tunable=True, doc="Mass m.")
    damping_n_s_per_m: float = hil.parameter(2.0, unit="N s/m", min=0.0, max=1e9, tunable=True, doc="Damping c.")
    stiffness_n_per_m: float = hil.parameter(
        100.0, unit="N/m", min=0.0, max=1e12, faultable=True, doc="Spring stiffness k."
    )
    disturbance_n: float = hil.parameter(
        0.0, unit="N", min=-1e9, max=1e9, faultable=True, doc="Force d that pushes the mass besides the command."
    )
    initial_position_m: float = hil.parameter(0.0, unit="m", min=-1e3, max=1e3, doc="Position at step 0.")
    initial_velocity_mps: float = hil.parameter(0.0, unit="m/s", min=-1e3, max=1e3, doc="Velocity at step 0.")


@dataclass
class Truth:
    """True state and outputs. A run that leaves a range ends as diverged."""

    position_m: float = hil.signal(unit="m", min=-1e6, max=1e6, doc="Position x, 0 where the spring is relaxed.")
    velocity_mps: float = hil.signal(unit="m/s", min=-1e6, max=1e6, doc="Velocity.")
    acceleration_mps2: float = hil.signal(unit="m/s2", doc="Acceleration under the present command.")
    energy_j: float = hil.signal(unit="J", doc="Kinetic energy and energy of the spring.")


@dataclass
class Motion:
    """Readings of the sensors, which are the whole state."""

    position_m: float = hil.signal(unit="m", doc="Position x.")
    velocity_mps: float = hil.signal(unit="m/s", doc="Velocity.")


@dataclass
class Command:
    """Command of the controller."""

    force_n: float = hil.signal(unit="N", doc="Force F on the mass.")


STIFFNESS_LOSS = hil.fault(
    "stiffness-loss",
    doc="The spring softens or breaks.",
    equation="k -> k (1 + (factor - 1) g)",
    sizes={"factor": hil.signal(unit="1", min=0.0, max=1.0, doc="Share of the stiffness left.")},
    moves={"stiffness_n_per_m": ("scale", "factor")},
)
PUSH = hil.fault(
    "push",
    doc="A force pushes the mass besides the command.",
    equation="d -> d + force g",
    sizes={"force_n": hil.signal(unit="N", min=-1e6, max=1e6, doc="The force.")},
    moves={"disturbance_n": ("add", "force_n")},
)


@hil.plant(
    parameters=Parameters, truth=Truth, measured=Motion, command=Command, state=Motion, faults=[STIFFNESS_LOSS, PUSH]
)
class SpringMass:
    """A mass on a spring with a damper, pushed by a commanded force."""

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.position_m = parameters.initial_position_m
        self.velocity_mps = parameters.initial_velocity_mps

    def retune(self, parameters: Parameters) -> None:
        self.parameters = parameters

    def acceleration_mps2(self, command: Command, x: float, v: float) -> float:
        """Returns x'' = (F + d - c x' - k x) / m."""
        p = self.parameters
        return (command.force_n + p.disturbance_n - p.damping_n_s_per_m * v - p.stiffness_n_per_m * x) / p.mass_kg

    def measure(self) -> Motion:
        return Motion(self.position_m, self.velocity_mps)

    def truth(self, time_s: float, command: Command) -> Truth:
        p, x, v = self.parameters, self.position_m, self.velocity_mps
        return Truth(
            position_m=x,
            velocity_mps=v,
            acceleration_mps2=self.acceleration_mps2(command, x, v),
            energy_j=0.5 * p.mass_kg * v * v + 0.5 * p.stiffness_n_per_m * x * x,
        )

    def advance(self, interval: hil.Interval, command: Command) -> None:
        def rates(time_s: float, state: Tuple[float, ...]) -> Tuple[float, float]:
            x, v = state
            return v, self.acceleration_mps2(command, x, v)

        self.position_m, self.velocity_mps = integrate((self.position_m, self.velocity_mps), interval, rates)


@dataclass
class Gains:
    """Parameters of the law."""

    proportional_n_per_m: float = hil.parameter(
        300.0, unit="N/m", min=-1e9, max=1e9, tunable=True, doc="Proportional gain k_p."
    )
    integral_n_per_m_s: float = hil.parameter(
        2000.0, unit="N/(m s)", min=-1e9, max=1e9, tunable=True, doc="Integral gain k_i."
    )
    derivative_n_s_per_m: float = hil.parameter(
        30.0, unit="N s/m", min=-1e9, max=1e9, tunable=True, doc="Derivative gain k_d."
    )
    command_limit_n: float = hil.parameter(
        math.inf, unit="N", min=0.0, tunable=True, doc="Largest magnitude of the force; infinite means no limit."
    )


@dataclass
class Position:
    """Signal that the law measures, and the one that it follows."""

    position_m: float = hil.signal(unit="m", doc="Position x.")


@dataclass
class State:
    """Numbers that the law keeps from sample to sample."""

    error_integral_m_s: float = hil.signal(unit="m s", doc="Integral of the error.")
    last_error_m: float = hil.signal(unit="m", doc="Error at the last sample.")


@hil.law(
    parameters=Gains, measured=Position, reference=Position, command=Command, state=State, plants=["spring-mass"]
)
class Pid:
    """A PID loop from the position's error to the force."""

    def __init__(self, setup: hil.Setup[Gains, None]) -> None:
        self.gains = setup.parameters
        self.period_s = setup.period_s
        self.error_integral_m_s = 0.0
        self.error_m: Optional[float] = None
        self.missed = 0
        self.force_n = 0.0

    @property
    def last_error_m(self) -> float:
        return self.error_m or 0.0

    @last_error_m.setter
    def last_error_m(self, error_m: float) -> None:
        self.error_m = error_m

    def retune(self, setup: hil.Setup[Gains, None], ramp: bool) -> None:
        """The new gains act from the next sample on; the integral stays."""
        self.gains = setup.parameters

    def step(self, sample: hil.Sample[Position, Position]) -> Command:
        if not sample.valid:
            self.missed += 1
            return Command(self.force_n)
        error_m = sample.reference.position_m - sample.measured.position_m
        elapsed_s = float(self.missed + 1) * self.period_s
        area, rate = 0.0, 0.0
        if self.error_m is not None:
            area, rate = 0.5 * (self.error_m + error_m) * elapsed_s, (error_m - self.error_m) / elapsed_s
        self.error_m, self.missed = error_m, 0

        k_p, k_i = self.gains.proportional_n_per_m, self.gains.integral_n_per_m_s
        rest = k_p * error_m + self.gains.derivative_n_s_per_m * rate
        limit = self.gains.command_limit_n
        target = rest + k_i * (self.error_integral_m_s + area)
        # At its limit the command must not wind up further.
        if not (abs(target) > limit and target * k_i * area > 0.0):
            self.error_integral_m_s += area
        self.force_n = min(max(rest + k_i * self.error_integral_m_s, -limit), limit)
        return Command(self.force_n)

    def save(self) -> Tuple[float, Optional[float], int, float]:
        return self.error_integral_m_s, self.error_m, self.missed, self.force_n

    def restore(self, value: Tuple[float, Optional[float], int, float]) -> None:
        self.error_integral_m_s, self.error_m, self.missed, self.force_n = value
