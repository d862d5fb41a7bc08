"""A comparison as a JUnit file."""

from vastflow.flows.comparison.campaigns import Compared
from vastflow.flows.comparison.text import points, share
from vastflow.flows.export.junit import Case, Flaw, Suite, campaign_report


def compared_report(found: Compared) -> bytes:
    """A suite with the gate alone, and one with a case for each paired configuration.

    The gate fails where it does not hold, with or without `--gate`, and is an error where it can't be claimed; a configuration where it is shown to fail newly.
    """
    whole = found.whole
    stated = {
        "before": share(whole.before),
        "after": share(whole.after),
        "difference_points": f"{100 * whole.difference:+.2f}",
        "interval_points": points(whole.interval),
        "pairs": str(whole.pairs),
        "lost": str(whole.lost),
        "gained": str(whole.gained),
    }
    gate = found.gate
    stated |= {"target": gate.target, "status": gate.status, "paths": str(whole.paths), "needed": str(gate.needed)}
    flaw = None if gate.holds else Flaw("error" if gate.status == "too few paths" else "failure", gate.text)
    case = Case("non-inferiority", "comparison", 0.0, properties=stated, flaw=flaw)
    return campaign_report("compare", [Suite("gate", [case]), Suite("configurations", _cases(found))])


def _cases(found: Compared) -> list[Case]:
    changed = {change.configuration: change for change in found.changes}
    cases = []
    for k, match in enumerate(found.pairing.matches):
        change = changed.get(k)
        flaw, stated = None, {"was": match.before, "paired": match.how}
        if change is not None:
            passes = f"{change.before} of {change.pairs} before, {change.after} after"
            stated |= {"passes": passes, "adjusted_p": f"{change.adjusted:.4g}"}
            if change.shown and change.worse:
                flaw = Flaw("failure", f"newly failing: {passes}")
        cases.append(Case(match.after, "configurations", 0.0, properties=stated, flaw=flaw))
    return cases
