"""An oracle as users of 0.2 wrote it."""

from vastflow.plugins import Metric, Oracle, OracleParameters, Verdict


class Near(Oracle[OracleParameters]):
    Parameters = OracleParameters
    metrics = {"at": "m"}

    def judge(self, trace, situation):
        if "x_m" not in trace.columns or not len(trace):
            return self.not_judged(trace, "no rows")
        at_m = float(trace["x_m"][-1])
        if at_m > 3.2 and trace.run.run_index:
            return self.not_judged(trace, "the robot ended in the other room")
        return Verdict(self.name, trace.run.run_index, judgement="pass", metrics={"at": Metric(at_m, "m")})
