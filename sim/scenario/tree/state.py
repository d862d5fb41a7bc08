"""State that the nodes of one tree share: clock, names with values, and events."""

import math
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import Any

from vastflow.sim.scenario.definition import Expression
from vastflow.sim.scenario.evaluation import evaluate


class TickClock:
    """Time as a number of ticks; moments are compared in whole microseconds.

    Attributes:
        number: The tick that is being made; 0 before the first.
        period_us: Between two ticks.
    """

    def __init__(self, period_s: float) -> None:
        """Raise ValueError for a period that is not a whole, positive number of microseconds."""
        self.number = 0
        self.period_us = round(period_s * 1e6) if math.isfinite(period_s) else 0
        if self.period_us < 1 or not math.isclose(self.period_us, period_s * 1e6, rel_tol=1e-9):
            raise ValueError(
                f"the period of a tick must be a whole number of microseconds, 1 or more, got {period_s!r} s"
            )

    @property
    def now_us(self) -> int:
        """The present tick's time."""
        return self.number * self.period_us

    @property
    def now_s(self) -> float:
        """The present tick's time."""
        return self.now_us / 1e6

    def in_us(self, duration_s: float) -> float:
        """Return the moment (µs) at this duration from now; infinity stays."""
        return self.now_us + microseconds(duration_s)

    def first_at(self, moment_us: float) -> float:
        """Return the first tick at a moment or after it."""
        return -(-moment_us // self.period_us)

    def first_after(self, moment_us: float) -> float:
        """Return the first tick strictly after a moment."""
        return moment_us // self.period_us + 1 if math.isfinite(moment_us) else moment_us


def microseconds(duration_s: float) -> float:
    """Return a duration in whole microseconds; infinity stays."""
    return round(duration_s * 1e6) if math.isfinite(duration_s) else duration_s


class RunState:
    """State of one run's tree, seen by its nodes alone.

    Attributes:
        names: Value of every name that an expression may use.
        variables: The `var`s among them, which actions may change.
        events: Events emitted so far; they stay emitted.
        moved: Something happened in the present tick beyond running leaves that go on running: a node began or
            ended, a variable or an event was set. Then the next tick may change something too.
        log: Takes a line for the run's log.
        monitors: Called before each tick, to keep variables up to date.
    """

    def __init__(
        self,
        clock: TickClock,
        names: Mapping[str, Any],
        functions: Mapping[str, Callable[..., Any]],
        log: Callable[[str], None],
    ) -> None:
        self.clock = clock
        self.names = dict(names)
        self.variables = Variables(self)
        self.events: set[str] = set()
        self.moved = False
        self.log = log
        self.monitors: list[Callable[[], None]] = []
        self._functions = functions

    def value(self, expression: Expression) -> Any:
        """Return the value of an expression; `ScenarioError` if it has none."""
        return evaluate(expression, self.names, self._functions)


class Variables(MutableMapping[str, Any]):
    """The `var`s of a run by name; an actor's are qualified, such as `robot.laps`.

    A struct is changed by setting the variable to another dict, never in place: waits would not hear of it.
    """

    def __init__(self, state: RunState) -> None:
        self._state = state
        self._homes: dict[str, tuple[dict[str, Any], str]] = {}

    def declare(self, name: str) -> None:
        """Allow setting a name, and the members of its actor."""
        actor, _, member = name.rpartition(".")
        self._homes[name] = (self._state.names[actor], member) if actor else (self._state.names, name)

    def __getitem__(self, name: str) -> Any:
        home, key = self._homes[name]
        return home[key]

    def __setitem__(self, name: str, value: Any) -> None:
        home, key = self._homes[name]
        home[key] = value
        self._state.moved = True

    def __delitem__(self, name: str) -> None:
        raise TypeError(f"{name}: a variable of a scenario can be set, not removed")

    def __iter__(self) -> Iterator[str]:
        return (name for name, (home, key) in self._homes.items() if key in home)

    def __len__(self) -> int:
        return sum(1 for _ in self)
