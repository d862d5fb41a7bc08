"""Plot how far the robot's estimated pose is from the true one, in one run for each noise level."""

from matplotlib.figure import Figure

from vastflow import execute, instantiate, observe

configurations = instantiate("campaigns/quickstart/quickstart.vast")
traces = observe(execute(configurations, runs=2, only="sensor-noise"))
figure = Figure(figsize=(8, 4))
axes = figure.subplots()
for name in traces.names:
    factors = configurations[name].factors
    if factors["laserscan_random_drop_percentage"] == 0.0:
        trace = traces.of(name)[0]
        axes.plot(trace["t_s"], trace["localization_error_m"], label=name)
axes.set(xlabel="time (s)", ylabel="localization error (m)")
axes.legend()
figure.savefig("localization_error.png", dpi=120)
print("localization_error.png")
