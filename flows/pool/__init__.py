"""A campaign's shards in a work pool of Prefect."""
