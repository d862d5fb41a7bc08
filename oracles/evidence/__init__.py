"""What verdicts add up to: rates, findings, and the runs of two campaigns that belong together."""
