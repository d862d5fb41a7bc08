"""Judge recorded runs by a stricter safety oracle; no run is executed again."""

from vastflow import execute, instantiate, judge, observe

configurations = instantiate("campaigns/quickstart/quickstart.vast")
traces = observe(execute(configurations, runs=2, only="clutter"))
for radius_m in (0.15, 0.25, 0.35):
    counts = judge(traces, oracles=[{"safety": {"robot_radius_m": radius_m}}]).counts("safety").values()
    print(
        f"robot radius {radius_m} m: {sum(c.passed for c in counts)} of {sum(c.judged for c in counts)} runs are safe"
    )
