"""The plan of a run, made in a folder that is gone afterwards."""

from pathlib import Path
from tempfile import TemporaryDirectory

from vastflow.flows.plan.plan import plan_of
from vastflow.flows.request.run_request import request_of


def planned(file, *, since=None, **options):
    with TemporaryDirectory() as environments:
        return plan_of(request_of(file, options), Path(environments), since)
