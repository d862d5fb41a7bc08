"""List the runs that took longest for their distance, with the command that replays each."""

from vastflow import run_campaign

result = run_campaign("campaigns/quickstart/quickstart.vast", runs=2, only="sensor-noise")
runs = result.frame()
runs["s_per_m"] = runs["simulated_s"] / runs["distance_m"].clip(lower=0.1)
for row in runs.nlargest(3, "s_per_m").itertuples():
    print(f"{row.s_per_m:.1f} s/m  vastflow replay {result.directory} {row.configuration} {row.run_index}")
