"""The engine: computes the missing artifacts of a campaign in processes of this machine or on a Dask cluster."""
