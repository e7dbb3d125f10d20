"""A hysteresis loop as a PyMeasure procedure, written to PyMeasure's own CSV file.

Start a daemon first (`dehyst run`), `pip install 'dehyst[pymeasure]'`, then:
python docs/examples/pymeasure_scan.py loop.csv
"""

import sys

import numpy as np
from pymeasure.experiment import FloatParameter, Procedure, Results, Worker

import dehyst


class Loop(Procedure):
    """Goes up and down again, with a reading at each position."""

    reach = FloatParameter("share of the reach", default=0.4)
    DATA_COLUMNS = ["target", "measured", "volts"]  # noqa: RUF012 - PyMeasure's own word

    def execute(self) -> None:
        with dehyst.Positioner() as stage:
            low, high = (0.5 + s * self.reach for s in (-0.5, 0.5))
            way = np.interp([*np.linspace(low, high, 6), *np.linspace(high, low, 6)[1:]],
                            [0.0, 1.0], stage.reach)  # fmt: skip
            for target in way:
                stage.go(target).result()
                seen = stage.read(0.05).result()
                self.emit("results", {"target": target, "measured": seen.measured,
                                      "volts": seen.volts})  # fmt: skip


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(
            "give the file to be written: python docs/examples/pymeasure_scan.py loop.csv"
        )
    worker = Worker(Results(Loop(), sys.argv[1]))
    worker.start()
    worker.join(60)
    status = worker.procedure.status
    if status != Procedure.FINISHED:
        how = "is not done after 60 s" if worker.is_alive() else "failed; its log says why"
        print(f"the procedure {how} (status {status})", file=sys.stderr)
    raise SystemExit(0 if status == Procedure.FINISHED else 1)
