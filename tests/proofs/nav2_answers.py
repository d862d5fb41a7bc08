"""Draw a small set of the recorded answers of Nav2's code, which the checkout keeps in `tests/proofs/nav2_answers`.

Of each file the cases with the greatest distances are taken, one of each kind, and others by a seed. Arrays that
`nav2_conformance.py` does not read are left out. A case of NavFn's gets the cells of its map as far as the plan depends on them: those near
what was reached; all others are unknown.

    python tests/proofs/nav2_answers.py ../shared/reference/nav2-conformance OUT
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from nav2_conformance import RESOLUTION_M, UNREACHED, Distance, map_cells, of_dwb, of_mppi, of_navfn, of_rpp

from vastflow.sim.nav2.costmaps.inflation import inflate

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
import navfn_paths

UNREAD: Final = frozenset({"tag", "new_sequence", "traj_end_odom", "traj_pose_count", "nav2_osc_rotate_after"})
UNKNOWN: Final = 255

Answers = Mapping[str, Any]


def numbered(answers: Answers) -> list[str]:
    """Return the cases of a file whose keys are `NN/name`."""
    return sorted({key.partition("/")[0] for key in answers})


def of_numbers(answers: Answers, cases: Iterable[str]) -> dict[str, Any]:
    """Return some cases of a file whose keys are `NN/name`."""
    wanted = set(cases)
    split = {key: key.partition("/")[::2] for key in answers}
    return {key: answers[key] for key, (case, name) in split.items() if case in wanted and name not in UNREAD}


def of_rows(answers: Answers, cases: Sequence[int]) -> dict[str, Any]:
    """Return some cases of a file whose arrays have a row for each, or as many as its offsets say."""
    count = len(answers["nav2_ok"])
    offsets = {name.removesuffix("offset"): rows for name, rows in answers.items() if name.endswith("_offset")}
    found = {}
    for name, array in answers.items():
        ragged = next((rows for prefix, rows in offsets.items() if name.startswith(prefix)), None)
        if name in UNREAD:
            continue
        if name.endswith("_offset"):
            found[name] = np.cumsum([0, *(array[case + 1] - array[case] for case in cases)]).astype(array.dtype)
        elif ragged is not None and len(array) == ragged[-1]:
            found[name] = np.concatenate([array[ragged[case] : ragged[case + 1]] for case in cases])
        elif array.ndim and len(array) == count and name != "critics":
            found[name] = array[list(cases)]
        else:
            found[name] = array
    return found


def with_cells(place: Path, answers: Answers) -> dict[str, Any]:
    """Return cases of NavFn's with the cells that their plans depend on, in place of the maps."""
    found = dict(answers)
    for case in numbered(answers):
        cells = map_cells(place, str(found.pop(f"{case}/map")))
        names = ("inscribed_radius_m", "inflation_radius_m", "cost_scaling_factor")
        radii = [float(answers[f"{case}/{name}"]) for name in names]
        start, goal = (tuple(map(int, answers[f"{case}/{name}"])) for name in ("start_cell_xy", "goal_cell_xy"))
        costs = inflate(cells.copy(), RESOLUTION_M, *radii)
        potential = navfn_paths.potential(costs, start, goal, use_astar=bool(answers[f"{case}/astar"]))
        rows, columns = np.nonzero(potential < UNREACHED)
        margin = math.ceil(radii[1] / RESOLUTION_M) + 3
        kept = np.full_like(cells, UNKNOWN)
        near = tuple(slice(max(axis.min() - margin, 0), axis.max() + margin + 1) for axis in (rows, columns))
        kept[near] = cells[near]
        found[f"{case}/cells"] = kept
    return found


def mppi_kind(answers: Answers, case: Any) -> Any:
    """Return what cases of one kind share."""
    return bool(answers[f"{case}/valid"]), bool((answers[f"{case}/costs"] >= 253).any())


def navfn_kind(answers: Answers, case: Any) -> Any:
    """Return what cases of one kind share."""
    return bool(answers[f"{case}/astar"]), len(answers[f"{case}/path_cells_xy"]) == 0


def dwb_kind(answers: Answers, case: Any) -> Any:
    """Return what cases of one kind share."""
    rotates, oscillates = answers["rotate_latched_before"][case], answers["osc_before"][case].any()
    return bool(answers["nav2_ok"][case]), *rotates.tolist(), bool(oscillates)


def rpp_kind(answers: Answers, case: Any) -> Any:
    """Return what cases of one kind share."""
    names = ("nav2_ok", "reached_before", "nav2_reached_after", "nav2_is_rotating")
    return tuple(int(answers[name][case]) for name in names)


class Part(NamedTuple):
    """A file of answers: how many cases of it are drawn by the seed, and how to take it apart."""

    file: str
    by_seed: int
    distances: Callable[[Path], Iterator[Distance]]
    kind: Callable[[Answers, Any], Any]
    is_numbered: bool


PARTS: Final = (
    Part("mppi.npz", 3, of_mppi, mppi_kind, True),
    Part("dwb.npz", 5, of_dwb, dwb_kind, False),
    Part("rpp.npz", 4, of_rpp, rpp_kind, False),
    Part("navfn.npz", 4, of_navfn, navfn_kind, True),
)


def drawn(place: Path, part: Part, rng: np.random.Generator) -> dict[str, Any]:
    """Return the extreme cases of a file, one of each kind, and others by the seed."""
    with np.load(place / part.file) as whole:
        answers = {name: whole[name] for name in whole.files}
    if part.file == "navfn.npz":
        answers = with_cells(place, answers)
    cases = numbered(answers) if part.is_numbered else list(range(len(answers["nav2_ok"])))
    subset = of_numbers if part.is_numbered else of_rows
    greatest: dict[str, tuple[float, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for case in cases:
            np.savez(Path(folder, part.file), **subset(answers, [case]))
            for each in part.distances(Path(folder)):
                if each.found > greatest.get(each.what, (0.0, None))[0]:
                    greatest[each.what] = each.found, case
    mixed = [cases[k] for k in rng.permutation(len(cases))]
    kinds = {part.kind(answers, case): case for case in mixed}
    chosen = {case for _, case in greatest.values()} | set(kinds.values())
    chosen |= set([case for case in mixed if case not in chosen][: part.by_seed])
    print(f"{part.file}: {len(chosen)} of {len(cases)} cases, greatest {greatest}")
    return subset(answers, sorted(chosen))


def main() -> None:
    """Write the set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("whole", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=39)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    for part in PARTS:
        np.savez_compressed(asked.out / part.file, **drawn(asked.whole, part, np.random.default_rng(asked.seed)))
        print(f"{(asked.out / part.file).stat().st_size} bytes")


if __name__ == "__main__":
    main()
