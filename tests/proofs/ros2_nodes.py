"""Do nodes of the real rclpy drive the simulated robot as they should?

Makes an environment by `ros2_environment.py`, or uses the one that `--environment` names, and runs `campaigns/nodes` and nodes of
`ros2_nodes_under_test` with it.

    python tests/proofs/ros2_nodes.py [--environment FOLDER] [--only PART ...] [--runs N] [--points N] [--seed N]

Parts: `example` (both configurations of the example, N runs by two workers: outcomes, and equal bytes), `observed` (what an observer that shares
no code with the bridge hears: types, QoS, rates, stamps, frames, the tree of transforms, the map, and each scan's bytes), `actions` (Nav2's three
actions, one that aborts), `limits` (nodes that flood a topic, die, never start, and publish no numbers), `containers` (the
example in containers by bubblewrap and runc, which needs an environment outside of /tmp: equal bytes to those without), `overhead` (CPU time of the
bridge and of the exchange with it in a simulated second, beside the built-in robot's), `kills` (kill -9 of the worker, the bridge, and
nodes at random points), `paced` (a node with a control timer of 20 Hz, of simulated time and of the host's, by two workers at 1 and 2 times
real time: how many are judged as the machine is, and beside eight busy processes; none may fail). Exit code 1 when one is not as it should be.
"""

import argparse
import base64
import contextlib
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import ros2_environment
import ros2_kills
import yaml

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.nodes import NodeProcess
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nodes import driven
from vastflow.sim.run import execute
from vastflow.sim.scenario.programs.folders import files_matching

CAMPAIGN = Path(__file__).parents[2] / "campaigns" / "nodes" / "nodes.vast"
UNDER_TEST = Path(__file__).parent / "ros2_nodes_under_test"
PARTS = ("example", "observed", "actions", "limits", "containers", "overhead", "kills", "paced")
OFFERED = {
    "/clock": ("rosgraph_msgs/msg/Clock", "BEST_EFFORT", "VOLATILE"),
    "/scan": ("sensor_msgs/msg/LaserScan", "BEST_EFFORT", "VOLATILE"),
    "/odom": ("nav_msgs/msg/Odometry", "RELIABLE", "VOLATILE"),
    "/tf": ("tf2_msgs/msg/TFMessage", "RELIABLE", "VOLATILE"),
    "/tf_static": ("tf2_msgs/msg/TFMessage", "RELIABLE", "TRANSIENT_LOCAL"),
    "/map": ("nav_msgs/msg/OccupancyGrid", "RELIABLE", "TRANSIENT_LOCAL"),
    "/initialpose": ("geometry_msgs/msg/PoseWithCovarianceStamped", "RELIABLE", "VOLATILE"),
    "/goal_pose": ("geometry_msgs/msg/PoseStamped", "RELIABLE", "VOLATILE"),
}
"""Topic to type, reliability, and durability, as Nav2's bringup has them."""
FLOOD = """
import os
import time
import rclpy
from rcl_interfaces.msg import Log
rclpy.init()
node = rclpy.create_node("flood")
loud, again = node.create_publisher(Log, "rosout", 10), Log(level=30, name="flood", msg="again")
began, count = time.monotonic(), 0
while True:
    loud.publish(again)
    count += 1
    if count % 10000 == 0:
        with open(os.environ["COUNT"], "w") as file:
            file.write(str(round(count / (time.monotonic() - began))))
"""
NAN = """
import rclpy
from geometry_msgs.msg import Twist
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
rclpy.init()
node = rclpy.create_node("nan")
command = node.create_publisher(Twist, "cmd_vel", 10)
def answer(message):
    twist = Twist()
    twist.linear.x = float("nan")
    command.publish(twist)
node.create_subscription(LaserScan, "scan", answer, qos_profile_sensor_data)
rclpy.spin(node)
"""

DIES = """
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
rclpy.init()
node = rclpy.create_node("dies")
scans = []
def count(message):
    scans.append(message)
    if len(scans) > 20:
        raise SystemExit("no wheels")
node.create_subscription(LaserScan, "scan", count, qos_profile_sensor_data)
rclpy.spin(node)
"""


HOSTILE = """
import os, sys, time
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
rclpy.init()
node = rclpy.create_node("hostile")
held = []
def act(message):
    if sys.argv[1] == "memory":
        held.append(b"1" * (1 << 30))
    elif sys.argv[1] == "disk":
        with open("zeros", "ab", buffering=0) as file:
            while True:
                file.write(bytes(1 << 20))
    else:
        while True:
            if os.fork() == 0:
                time.sleep(99)
node.create_subscription(LaserScan, "scan", act, qos_profile_sensor_data)
rclpy.spin(node)
"""


class Proof:
    def __init__(self, python: Path) -> None:
        self.python, self.wrong = str(python), 0
        campaign = load_campaign(CAMPAIGN)
        self.scenarios = {each.name: each.scenario for each in instantiate(campaign).configurations}

    def check(self, is_right: bool, said: str) -> None:
        self.wrong += not is_right
        print(f"{'ok' if is_right else 'WRONG'}: {said}", flush=True)

    def scenario(self, name: str, processes: list[NodeProcess] | None = None, **changes: Any) -> Scenario:
        """Return a configuration of the example with the environment's Python, and perhaps other nodes."""
        found = self.scenarios[name]
        assert found.programs is not None and found.programs.nodes is not None
        own = found.programs.nodes.processes if processes is None else processes
        own = tuple(replace(each, command=(self.python, *each.command[1:])) for each in own)
        nodes = replace(found.programs.nodes, processes=own, python=self.python, **changes)
        files = (*found.programs.files, *files_matching(UNDER_TEST, ["*.py"]))
        return replace(found, programs=replace(found.programs, nodes=nodes, files=files))

    def campaign(self) -> str:
        """Return the example's campaign file with the environment's Python."""
        text = CAMPAIGN.read_text().replace("ros2:\n", f"ros2:\n    python: {self.python}\n", 1)
        return text.replace("command: python3", f"command: {self.python}")

    def contained(
        self, name: str, mode: str, nodes: list[NodeProcess] | None = None, **limits: float | None
    ) -> Scenario:
        """Return a configuration of the example in containers by a runtime, or without where `mode` is `plain`."""
        found = self.scenario(name, nodes)
        if mode == "plain":
            return found
        assert found.programs is not None
        main = {"main": {**ros2_kills.container(mode, self.python), **limits}}
        return replace(found, programs=replace(found.programs, containers=main, container_runtime=mode))

    def example(self, runs: int) -> None:
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(CAMPAIGN.parent, Path(folder) / "nodes")
            (Path(folder) / "nodes" / "nodes.vast").write_text(self.campaign())
            command = [
                sys.executable,
                "-m",
                "vastflow.flows.cli",
                "run",
                f"{folder}/nodes/nodes.vast",
                "--workers",
                "2",
            ]
            options = [
                "--runs",
                str(runs // 2),
                "--results",
                f"{folder}/results",
                "--store",
                f"{folder}/store",
                "--json",
            ]
            before_s = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
            ran = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
            spent_s = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - before_s
            self.check(
                ran.returncode == 0,
                f"{runs} runs, {spent_s:.0f} CPU-s, exit code {ran.returncode}{ran.stderr[-400:] * bool(ran.returncode)}",
            )
            for name, outcome in (("free", "succeeded"), ("blocked", "timed_out")):
                (results,) = Path(folder, "results").iterdir()
                from vastflow.oracles.results.executed import recordings_of

                found = recordings_of(results, name).values()
                outcomes = Counter(each.run.outcome for each in found)
                self.check(outcomes == {outcome: runs // 2}, f"{name}: {dict(outcomes)}")
                seeds = Counter(replace(each, run=replace(each.run, run_index=0, seed="0")).digest for each in found)
                self.check(len(seeds) == 1, f"{name}: {max(seeds.values())} of {len(found)} runs with equal bytes")

    def observed(self) -> None:
        ranges, old = [], driven.DrivenSimulation._new_scan

        def kept(simulation: driven.DrivenSimulation) -> Any:
            scan = old(simulation)
            if scan is not None:
                ranges.append(scan)
            return scan

        driven.DrivenSimulation._new_scan = kept  # type: ignore[method-assign]
        try:
            own = self.scenarios["free"].programs.nodes.processes  # type: ignore[union-attr]
            observer = NodeProcess("observer", ("python3", "observer.py"), ready="node", ready_at="observer")
            execution = execute(self.scenario("free", [observer, *own]), 0)
        finally:
            driven.DrivenSimulation._new_scan = old  # type: ignore[method-assign]
        self.check(execution.recording.run.outcome == "succeeded", f"observed run: {execution.recording.run.outcome}")
        lines = [json.loads(line) for line in execution.recording.outputs.files["observed.jsonl"].splitlines()]
        offers = {line["topic"]: (line["type"], *line["qos"]) for line in lines if line["stamp_ns"] == -1}
        for topic, expected in OFFERED.items():
            self.check(offers.get(topic) == expected, f"{topic}: {offers.get(topic)}")
        heard = {
            topic: [line for line in lines if line["topic"] == topic and line["stamp_ns"] >= 0] for topic in OFFERED
        }
        for topic, period_ns in (("/clock", 50_000_000), ("/odom", 50_000_000), ("/scan", 100_000_000)):
            stamps = [line["stamp_ns"] for line in heard[topic]]
            steps = Counter(np.diff(sorted(set(stamps))).tolist())
            is_right = min(steps) == period_ns and not any(
                step % period_ns for step in steps
            )  # some may be lost on a busy host
            self.check(is_right, f"{topic}: {len(stamps)} messages, steps {dict(steps)} ns")
        said = {line["stamp_ns"]: base64.b64decode(line["ranges"]) for line in heard["/scan"]}
        equal = sum(said.get(round(stamp_s * 1e9)) == content for stamp_s, content in ranges)
        self.check(
            equal == len(ranges) == len(said),
            f"/scan: {equal} of {len(ranges)} equal to the simulator's, {len(said)} heard",
        )
        frames = {tuple(line["frames"]) for topic in ("/tf", "/tf_static") for line in heard[topic]}
        self.check(
            frames == {("map", "odom"), ("odom", "base_link"), ("base_link", "base_scan")},
            f"transforms: {sorted(frames)}",
        )
        self.check({tuple(line["frames"]) for line in heard["/odom"]} == {("odom", "base_link")}, "/odom: its frames")
        self.check(
            len(heard["/map"]) == 1, f"/map: {len(heard['/map'])} message, latched, for an observer that came later"
        )

    def actions(self) -> None:
        server = NodeProcess("navigator", ("python3", "actions.py"), ready="action", ready_at="/navigate_to_pose")
        sent = {"x": 1.0, "y": 1.0, "yaw": 0.0}
        stops = [{"x": 2.0, "y": 1.0, "yaw": 0.0}, {"x": 3.0, "y": 1.0, "yaw": 0.0}]
        for kind, goal, outcome, reason in (
            ("navigate_to_pose", {"goal_pose": stops[1]}, "succeeded", ""),
            ("navigate_through_poses", {"goal_poses": stops}, "succeeded", ""),
            ("follow_waypoints", {"goal_poses": stops}, "succeeded", ""),
            ("navigate_to_pose", {"goal_pose": {"x": 9.0, "y": 1.0, "yaw": 0.0}}, "aborted", "too far for me"),
        ):
            base = self.scenario("free", [server], mission="action", localization="ideal")
            task = {"start_pose": sent, **goal}
            found = replace(base, abstract=f"builtin:{kind}", task=task)
            run = execute(found, 0).recording.run
            self.check(run.outcome == outcome and reason in run.reason, f"{kind}: {run.outcome} {run.reason[:80]}")

    def limits(self) -> None:
        own = list(self.scenarios["free"].programs.nodes.processes)  # type: ignore[union-attr]
        flood = NodeProcess("flood", ("python3", "-c", FLOOD))
        with tempfile.TemporaryDirectory() as folder:
            counted = replace(flood, environment={"COUNT": f"{folder}/count"})
            try:
                said = execute(self.scenario("free", [*own, counted]), 0).recording.run.outcome
            except ScenarioError as error:  # on a slow host it has no room for answers
                said = str(error)
            rate = (Path(folder) / "count").read_text()
        is_right = said == "succeeded" or "/cmd_vel did not answer the scan" in said
        self.check(is_right, f"a flood of /rosout, {rate} messages/s: {said}")
        run = execute(
            self.scenario("free", [NodeProcess("nan", ("python3", "-c", NAN), ready="topic", ready_at="/cmd_vel")]), 0
        )
        self.check(
            "expected numbers, got [nan" in run.recording.run.reason, f"no numbers: {run.recording.run.reason[:80]}"
        )
        dies = NodeProcess("dies", ("python3", "-c", DIES))
        run = execute(self.scenario("blocked", [*own, dies]), 0)
        self.check(
            "node 'dies' exited with code 1: no wheels" in run.recording.run.reason,
            f"dies: {run.recording.run.reason[:80]}",
        )
        for process, why in (
            (
                NodeProcess(
                    "silent",
                    ("python3", "-c", "import time; time.sleep(99)"),
                    ready="topic",
                    ready_at="/cmd_vel",
                    ready_within_s=2.0,
                ),
                "no topic",
            ),
            (
                NodeProcess("absent", ("python3", "no-such.py"), ready="topic", ready_at="/cmd_vel"),
                "exited with code 2",
            ),
        ):
            self._breaks(self.scenario("free", [process]), why)
        for mode in ("bubblewrap", "runc"):
            memory, disk, forks = (
                [NodeProcess("hostile", ("python3", "-c", HOSTILE, kind), ready="node", ready_at="hostile"), *own]
                for kind in ("memory", "disk", "forks")
            )
            found = self.contained("blocked", mode, memory, memory=512 << 20)
            self._breaks(found, f"container 'main' by {mode}: its memory of 512 MiB was full")
            self._breaks(self.contained("free", mode, cpu=0.01), "within 30 s", "succeeded")  # slowly
            execution = execute(self.contained("blocked", mode, forks, processes=64), 0)
            run, why = execution.recording.run, "BlockingIOError: [Errno 11] Resource temporarily unavailable"
            said = next(each.text for each in execution.log.texts if each.label == "hostile")
            # By runc it lives on with what it forked, and holds its output.
            is_right = f"node 'hostile' exited with code 1: {why}" in run.reason or (
                mode == "runc" and run.outcome == "timed_out" and why in said
            )
            self.check(is_right, f"{mode}: forks: {run.outcome} {run.reason}")
            with ros2_kills.small_disk() as folder:
                self._breaks(self.contained("blocked", mode, disk), f"No space left on device: '{folder}/vastflow-run-")

    def _breaks(self, scenario: Scenario, *whys: str) -> None:
        """Check that a run is a fault whose sentence has one of `whys`."""
        try:
            said = execute(scenario, 0).recording.run.outcome
        except (ScenarioError, OSError) as error:
            said = str(error)
        self.check(any(why in said for why in whys), said[:140])

    def containers(self) -> None:
        plain = execute(self.scenario("free"), 0).recording.digest
        with ros2_kills.docker() if shutil.which("dockerd") else contextlib.nullcontext():
            for runtime in ("bubblewrap", "runc", *(["docker"] if shutil.which("dockerd") else [])):
                execution = execute(self.contained("free", runtime), 0)
                is_equal = execution.recording.digest == plain
                self.check(
                    is_equal,
                    f"{runtime}: equal bytes {is_equal}, {execution.log.cpu_s:.1f} CPU-s, {execution.log.notes}",
                )

    def overhead(self) -> None:
        spent: Counter[str] = Counter()
        bridges: list[tuple[psutil.Process, float]] = []
        advance, exchange = ClosedLoop.advance, driven.DrivenSimulation._exchange

        def timed_advance(loop: ClosedLoop, until_tick: int | None = None) -> None:
            began_s = time.thread_time()
            advance(loop, until_tick)
            spent["world and stack"] += time.thread_time() - began_s

        def timed_exchange(simulation: driven.DrivenSimulation, scan: Any) -> None:
            if not bridges:
                pids = map(psutil.Process, simulation._started.programs.pids())
                (bridge,) = (each for each in pids if "bridge.py" in " ".join(each.cmdline()))
                bridges.append((bridge, sum(bridge.cpu_times()[:2])))
            began_s = time.thread_time()
            exchange(simulation, scan)
            spent["exchange"] += time.thread_time() - began_s
            spent["bridge"] = sum(bridges[0][0].cpu_times()[:2]) - bridges[0][1]

        found = self.scenario("blocked")
        execute(replace(found, programs=None), 0)  # compiles kernels
        ClosedLoop.advance = timed_advance  # type: ignore[method-assign]
        driven.DrivenSimulation._exchange = timed_exchange  # type: ignore[method-assign]
        for kind, scenario in (("built-in robot", replace(found, programs=None)), ("nodes", found)):
            spent.clear()
            run = execute(scenario, 0).recording.run
            parts = {name: f"{1e3 * cpu_s / run.simulated_s:.1f} ms" for name, cpu_s in spent.items()}
            self.check(
                run.simulated_s > 5.0, f"{kind}: CPU time in one of {run.simulated_s:.0f} simulated seconds {parts}"
            )
        ClosedLoop.advance = advance  # type: ignore[method-assign]
        driven.DrivenSimulation._exchange = exchange  # type: ignore[method-assign]

    def kills(self, points: int, seed: int, mode: str) -> None:
        ros2_kills.strikes(self.check, __file__, self.campaign(), self.python, points, seed, mode)

    def paced(self, runs: int) -> None:
        for busy in (0, 8):
            text = f"import os\nwhile os.getppid() == {os.getpid()}: pass"
            hogs = [subprocess.Popen([sys.executable, "-c", text], start_new_session=True) for _ in range(busy)]
            try:
                for clock, factor, computes_s in (("sim", 1, 0), ("host", 1, 0), ("sim", 2, 0), ("host", 1, 0.02)):
                    self._paced(runs, f"{clock} {computes_s}", factor, busy)
            finally:
                for each in hogs:
                    each.kill()
                    each.wait()

    def _paced(self, runs: int, arguments: str, factor: int, busy: int) -> None:
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(CAMPAIGN.parent, Path(folder) / "nodes")
            shutil.copy(UNDER_TEST / "timed.py", Path(folder) / "nodes")
            content = yaml.safe_load(CAMPAIGN.read_text())
            content["configuration"].pop()
            command = f"{self.python} timed.py {arguments}"
            content["execution"] |= {
                "run_files": ["timed.py"],
                "nodes": [{"timed": {"command": command, "ready": {"topic": "/cmd_vel"}}}],
            }
            content["execution"]["ros2"] |= {"python": self.python, "time": "paced", "real_time_factor": factor}
            (Path(folder) / "nodes" / "nodes.vast").write_text(yaml.safe_dump(content))
            places = ["--results", f"{folder}/results", "--store", f"{folder}/store"]
            command_line = [
                sys.executable,
                "-m",
                "vastflow.flows.cli",
                "run",
                f"{folder}/nodes/nodes.vast",
                "--workers",
                "2",
            ]
            ran = subprocess.run(
                [*command_line, "--runs", str(runs), *places, "--json"], capture_output=True, text=True, check=False
            )
            (results,) = Path(folder, "results").iterdir()
            metadata = json.loads((results / "metadata.json").read_text())
            counts = metadata["counts"]
            passed, failed, broken = (counts[name] for name in ("passed", "failed", "not_judged"))
            is_right = failed == 0 and passed + broken == runs and (broken == 0 or busy > 0 or os.getloadavg()[0] > 2.5)
            said = next((line for line in ran.stderr.splitlines() if "as a paced run takes" in line), "no bound")
            self.check(
                is_right,
                f"timed.py {arguments} at {factor}, {busy} busy, load {os.getloadavg()[0]:.1f}: {passed} passed, {failed} failed, "
                f"{broken} not judged. {metadata['health']}. {said.strip()}",
            )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--environment", type=Path)
    parser.add_argument("--only", nargs="+", default=PARTS, choices=[*PARTS, "one"])
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--points", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--mode", choices=ros2_kills.MODES, default="", help="of kills: how nodes are run; all ways if not given"
    )
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        environment = ros2_environment.Environment((asked.environment or Path(folder) / "environment").resolve())
        environment.make()
        proof = Proof(environment.python)
        if "one" in asked.only:
            execute(proof.contained("blocked", asked.mode), 0)
            return 0
        for part in asked.only:
            print(f"== {part}")
            runs = [asked.runs]
            arguments = {"example": runs, "paced": runs, "kills": [asked.points, asked.seed, asked.mode]}.get(part, [])
            getattr(proof, part)(*arguments)
    print(f"{proof.wrong} wrong")
    return int(proof.wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
