"""Deployments: work pools, job templates, images, and schedules."""

if __name__ != "vastflow.deployments":
    raise ImportError(f"import vastflow.deployments, not {__name__}: one module has one name")
