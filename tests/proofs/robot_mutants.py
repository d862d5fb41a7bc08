"""Count the defects of a robot broken on purpose that quick tests find.

The tests are those of `tests/sim`. Each mutant is one replacement in a copy of the checkout. Its tests run until the first that fails, those that compile least first. Kernels
are compiled anew for each, in a cache of its own that is removed afterwards. At the end the tests that found a mutant run without
one, and have to pass.

    python tests/proofs/robot_mutants.py [--old-processor] [--only NAME ...]

`--old-processor` hides AVX2, FMA and AVX-512 from the C library, numpy, and the compiler of kernels.

Exit code 1 when a mutant is not found; 2 when a test that found one fails without it as well, or a mutant does not fit the source any more.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
TIMEOUT_S: Final = 7200
"""Timeout of one mutant; tests that end by a clock don't tell that they found it."""
NO_FINDING: Final = re.compile(r"Timeout|TypingError|LoweringError|ContractError|ImportError|SyntaxError")
"""Failures of a mutant that no test had to find."""

OLD_PROCESSOR: Final[Mapping[str, str]] = {
    # As `ld.so --list-tunables` and --list-diagnostics of glibc 2.36 name them; 2.32 and before append `_Usable`.
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX512CD,-AVX512BW,-AVX512DQ,-AVX512VL",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_FEATURES": "",
}
"""Variables that leave an x86-64 processor of 2009 (x86-64-v2)."""


DRIVEN: Final = "test_sim_golden_runs.py"


class Mutant(NamedTuple):
    """A replacement in a file below the root, and the tests below `tests/sim` that reach it, in order."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...] = (DRIVEN,)


TICK: Final = "sim/nav2/navigator/tick.py"
BEHAVIOR: Final = "sim/nav2/navigator/behavior.py"
RECORD: Final = "sim/nav2/navigator/parameter_record.py"

MUTANTS: Final = (
    # Accelerations.
    Mutant("smoother: half the acceleration", TICK, "limit = q.max_accel[axis]", "limit = 0.5 * q.max_accel[axis]"),
    Mutant("smoother: half the braking", TICK, "else -q.max_decel[axis]", "else -0.5 * q.max_decel[axis]"),
    Mutant("wheels: half the acceleration", TICK, "m.wheel_v, p.max_speed, p.max", "m.wheel_v, p.max_speed, 0.5 * p.max"),
    Mutant("wheels: half the yaw acceleration", TICK, "m.wheel_w, p.max_yaw_rate, p.m", "m.wheel_w, p.max_yaw_rate, 0.5 * p.m"),
    # Radii.
    Mutant("footprint: half the padding", "sim/nav2/costmaps/outline.py", "padding_m * np.sign", "0.5 * padding_m * np.sign",
           ("test_sim_footprint.py", DRIVEN)),
    Mutant("costmap: a smaller inscribed radius", "sim/nav2/costmaps/inflation.py", "np.where(distance_m <= inscribed_radius_m",
           "np.where(distance_m <= 0.9 * inscribed_radius_m", ("test_sim_costmap.py", DRIVEN)),
    Mutant("body: a smaller radius", "sim/world/motion.py", "reach_m = body.radius_m + MARGIN_M", "reach_m = 0.9 * body.radius_m",
           ("test_sim_motion.py", DRIVEN)),
    Mutant("drive: half the turning radius", "sim/world/motion.py", "/ min_turning_radius_m", "/ (0.5 * min_turning_radius_m)",
           ("test_sim_motion.py", "test_sim_drives.py", DRIVEN)),
    # Noise.
    Mutant("odometry: half the noise", TICK, "v * (1.0 + noise * a), w", "v * (1.0 + 0.5 * noise * a), w"),
    Mutant("lidar: half the noise", "sim/world/gaussian_dropout.py", "+= noise_m * first", "+= 0.5 * noise_m * first",
           ("test_sim_lidar_noise.py", "test_sim_lidar.py", DRIVEN)),
    Mutant("lidar: half the lost beams", "sim/world/gaussian_dropout.py", "int(beams * dropout)", "int(0.5 * beams * dropout)",
           ("test_sim_lidar_noise.py", "test_sim_lidar.py", DRIVEN)),
    Mutant("AMCL: less noise of the way", "sim/nav2/amcl/particles.py", "sqrt(q.alpha3 * trans", "sqrt(0.5 * q.alpha3 * trans",
           ("test_sim_amcl_particles.py", DRIVEN)),
    Mutant("AMCL: a wider beam", "sim/nav2/amcl/sensor.py", "(2 * sigma_hit_m**2)", "(3 * sigma_hit_m**2)",
           ("test_sim_amcl_likelihood.py", DRIVEN)),
    # Rates.
    Mutant("lidar: half the rate", RECORD, '"scan_ticks": ticks_of(', '"scan_ticks": 2 * ticks_of('),
    Mutant("controller: half the rate", RECORD, '"control_ticks": ticks_of(', '"control_ticks": 2 * ticks_of('),
    Mutant("local costmap: half the rate", RECORD, '"local_ticks": ticks_of(', '"local_ticks": 2 * ticks_of('),
    Mutant("planner: half the rate", BEHAVIOR, "REPLAN_TICKS: Final = round(1.0", "REPLAN_TICKS: Final = round(2.0",
           (DRIVEN, "test_sim_behavior.py")),
    # Costs.
    Mutant("costmap: a slower decay", "sim/nav2/costmaps/inflation.py", "np.exp(-cost_sc", "np.exp(-0.9 * cost_sc",
           ("test_sim_costmap.py", DRIVEN)),
    Mutant("NavFn: a flatter cost", "sim/nav2/planners/navfn.py", "+ 0.8 * cost)", "+ 0.7 * cost)", (DRIVEN, "test_sim_navfn.py")),
    Mutant("MPPI: a lighter cost critic", "sim/nav2/controllers/mppi_critics.py", "total * splat(weight), splat(crash)",
           "total * splat(0.8 * weight), splat(crash)", (DRIVEN, "test_sim_mppi.py")),
    Mutant("DWB: a lighter path critic", "sim/nav2/controllers/dwb.py", "half_m * q.PathDist.scale", "half_m * 0.9 * q.PathDist.scale",
           (DRIVEN, "test_sim_dwb.py")),
    # Recoveries.
    Mutant("recovery: a spin of a third less", BEHAVIOR, "SPIN_RAD: Final = 1.57", "SPIN_RAD: Final = 1.05",
           (DRIVEN, "test_sim_behavior.py")),
    Mutant("recovery: a shorter way back", BEHAVIOR, "BACK_UP_M: Final = 0.30", "BACK_UP_M: Final = 0.25",
           (DRIVEN, "test_sim_behavior.py")),
    Mutant("recovery: a shorter wait", BEHAVIOR, "WAIT_TICKS: Final = round(5.0", "WAIT_TICKS: Final = round(4.0",
           (DRIVEN, "test_sim_behavior.py")),
    Mutant("recovery: one retry fewer", BEHAVIOR, "RETRIES: Final = 6", "RETRIES: Final = 5", (DRIVEN, "test_sim_behavior.py")),
    Mutant("recovery: the global costmap stays", BEHAVIOR, "int(what != state.CLEAR_LOCAL)", "0", (DRIVEN, "test_sim_behavior.py")),
    # The loop and the monitor.
    Mutant("collision monitor: half the time ahead", "sim/nav2/navigator/collision_monitor.py", "while t_s < ahead_s",
           "while t_s < 0.5 * ahead_s", (DRIVEN, "test_sim_collision_monitor.py")),
    Mutant("loop: obstacles appear at once", "sim/loop/closed_loop.py", "round(t.delay_s / TICK_S)", "0.0",
           ("test_sim_run.py", DRIVEN)),
)  # fmt: skip


class MisfitError(Exception):
    """A mutant does not fit the source."""


def copied(folder: Path) -> Path:
    """Copy the checkout's own files, links as links."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_symlink() or (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
    return folder


def run_tests(checkout: Path, tests: Sequence[str], environment: Mapping[str, str]) -> tuple[int, str, float]:
    """Return pytest's exit code, the first test that failed, and the seconds of CPU time."""
    # A mutant of the same length and second would meet the other's bytecode.
    known = {**os.environ, "PYTHONPATH": str(checkout / ".package"), "PYTHONDONTWRITEBYTECODE": "1", **environment}
    where = [sys.executable, "-c", "import vastflow.sim.run as run; print(run.__file__)"]
    found = subprocess.run(where, cwd=checkout, env=known, check=True, capture_output=True, text=True).stdout
    assert Path(found.strip()).is_relative_to(checkout), found
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-p",
        "no:cacheprovider",
        "--tb=line",
        f"--timeout={TIMEOUT_S}",
    ]
    before_s = sum(os.times()[2:4])
    done = subprocess.run(
        [*command, *tests],
        cwd=checkout,
        env=known,
        check=False,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    if done.returncode == 1 and (wrong := NO_FINDING.search(done.stdout)):
        raise MisfitError(f"expected a test that fails, got {wrong[0]}:\n{done.stdout[-2000:]}")
    failed = re.search(r"^(?:SUBFAILED|FAILED)\S*(?:.*?\] )?\s*(\S+::\S+)", done.stdout, re.MULTILINE)
    return done.returncode, failed[1] if failed else done.stdout[-2000:], sum(os.times()[2:4]) - before_s


def judged(checkout: Path, mutant: Mutant, environment: Mapping[str, str]) -> tuple[bool, str, float]:
    """Return whether the tests find a mutant, the test that does, and the seconds of CPU time."""
    file = checkout / mutant.file
    source = file.read_text(encoding="utf-8")
    if source.count(mutant.old) != 1:
        raise MisfitError(f"{mutant.file}: expected {mutant.old!r} once, got it {source.count(mutant.old)} times")
    file.write_text(source.replace(mutant.old, mutant.new), encoding="utf-8")
    try:
        with tempfile.TemporaryDirectory(prefix="kernels-") as cache:
            own = {**environment, "XDG_CACHE_HOME": cache}
            code, failed, cpu_s = run_tests(checkout, [f"tests/sim/{test}" for test in mutant.tests], own)
    finally:
        file.write_text(source, encoding="utf-8")
    if code not in (0, 1):
        raise MisfitError(f"{mutant.name}: expected tests that pass or fail, got exit code {code}:\n{failed}")
    return code == 1, failed if code else "", cpu_s


def main() -> int:
    """Print a row for each mutant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old-processor", action="store_true")
    parser.add_argument("--only", action="append", metavar="NAME", choices=[mutant.name for mutant in MUTANTS])
    asked = parser.parse_args()
    chosen = [mutant for mutant in MUTANTS if not asked.only or mutant.name in asked.only]
    environment = OLD_PROCESSOR if asked.old_processor else {}
    with tempfile.TemporaryDirectory(prefix="robot-mutants-") as folder:
        checkout = copied(Path(folder))
        print("| mutant | found by | CPU-s |\n|---|---|---|", flush=True)
        finders = []
        for mutant in chosen:
            try:
                is_found, failed, cpu_s = judged(checkout, mutant, environment)
            except MisfitError as error:
                print(error, file=sys.stderr)
                return 2
            finders += [failed] * is_found
            print(f"| {mutant.name} | {f'`{failed}`' if is_found else '**not found**'} | {cpu_s:.0f} |", flush=True)
        code, failed, _ = run_tests(checkout, sorted(set(finders)), environment) if finders else (0, "", 0.0)
        if code:
            print(f"without a mutant: expected tests that pass, got exit code {code}: {failed}", file=sys.stderr)
            return 2
    print(f"\n{len(finders)} of {len(chosen)} found, by {len(set(finders))} tests that pass without a mutant.")
    return 0 if len(finders) == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
