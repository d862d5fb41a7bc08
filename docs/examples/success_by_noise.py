"""Run a part of the quickstart and print the rate of passed runs of each noise level."""

from vastflow import run_campaign

result = run_campaign("campaigns/quickstart/quickstart.vast", runs=2, only="sensor-noise")
runs = result.frame()
print(runs.groupby("laserscan_gaussian_noise_std_deviation")["passed"].agg(["mean", "size"]))
print("report:", result.directory / "report.html")
