"""What verdicts add up to: rates, causes, findings, and the runs of two campaigns that belong together."""
