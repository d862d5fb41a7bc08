"""Recordings of scenarios: what happened, which behaviors ended, and where the robot came to; and texts of random scenarios."""

import textwrap

from hypothesis import strategies as st

from vastflow.sim.model.recording import si


def happened(recording, *kinds):
    """The events of these kinds."""
    return [event for event in recording.run.events if event.kind in kinds]


def ends(recording, name):
    """(time, status, message) of every end of the behaviors of a name, in order."""
    b = recording.behaviors
    rows = zip(b["name"], b["t_s"], b["status"], b["message"], strict=True)
    return [(float(t), s, m) for n, t, s, m in rows if n == name and (s in ("SUCCESS", "FAILURE") or m == "cancelled")]


def final(recording):
    """The robot's last position (m)."""
    return si(recording.columns["x_mm"])[-1], si(recording.columns["y_mm"])[-1]


def bodies(leaves, durations, conditions, max_leaves):
    """Texts of compositions of leaves, with modifiers round some of them."""
    modifiers = st.one_of(
        durations.map("timeout({}s)".format),
        st.sampled_from(["repeat()", "repeat(1)", "repeat(2)", "repeat(3)", "retry(1)", "retry(2)", "retry(3)"]),
        st.sampled_from(["inverter()", "failure_is_running()", "failure_is_success()", "running_is_failure()"]),
        st.sampled_from(["running_is_success()", "success_is_failure()", "success_is_running()"]),
        conditions.map("until {}".format),
    )

    def composed(kind, children, around):
        below = textwrap.indent("\n".join(children), "    ")
        return f"{kind}:\n{below}" + (f"\nwith:\n    {around}" if around else "")

    kinds = st.sampled_from(["serial", "serial", "parallel", "one_of"])
    return st.recursive(
        leaves,
        lambda below: st.builds(composed, kinds, st.lists(below, min_size=1, max_size=4), st.none() | modifiers),
        max_leaves=max_leaves,
    )
