"""What the nodes of one tree share: the clock, names and their values, the flags of events."""

from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import Any

from vastflow.sim.behaviour.clock import TickClock
from vastflow.sim.osc.definition import Expression
from vastflow.sim.osc.evaluation import evaluate


class RunState:
    """State of one run's tree, seen by its nodes alone.

    Attributes:
        names: Value of every name that an expression may use.
        variables: The `var`s among them, which actions may change.
        events: Those emitted so far; they stay so.
        moved: Something happened in the present tick beyond running leaves that go on running: a node began or
            ended, a variable or an event was set. Then the next tick may change something too.
        log: Takes a line for the run's log.
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
        self._functions = functions

    def value(self, expression: Expression) -> Any:
        """Value of an expression at this moment; `EvaluationError` where it has none."""
        return evaluate(expression, self.names, self._functions)


class Variables(MutableMapping[str, Any]):
    """The `var`s of a run: names that may be set, and no others.

    A struct is changed by setting the variable to another dict, never in place: waits would not hear of it.
    """

    def __init__(self, state: RunState) -> None:
        self._state = state
        self._declared: dict[str, None] = {}

    def declare(self, name: str) -> None:
        """Let a name be set."""
        self._declared[name] = None

    def __getitem__(self, name: str) -> Any:
        if name not in self._declared:
            raise KeyError(name)
        return self._state.names[name]

    def __setitem__(self, name: str, value: Any) -> None:
        if name not in self._declared:
            raise KeyError(name)
        self._state.names[name] = value
        self._state.moved = True

    def __delitem__(self, name: str) -> None:
        raise TypeError(f"{name}: a variable of a scenario can be set, not removed")

    def __iter__(self) -> Iterator[str]:
        return (name for name in self._declared if name in self._state.names)

    def __len__(self) -> int:
        return sum(1 for _ in self)
