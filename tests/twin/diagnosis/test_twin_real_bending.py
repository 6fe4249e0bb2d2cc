"""Real bending actuators of which only a tip's places are known: the honest verdict is that there is none."""

from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy.io import loadmat

from twin.diagnosis.procedure import diagnose
from twin.project.targetfiles import read_targets

HEAD = "block,step,time_s,pressure_MPa,point,u1_mm,u2_mm,u3_mm,sd1_mm,sd2_mm,sd3_mm,valid"


def test_a_tips_places_alone_cannot_be_tested(shared_data: Path, tmp_path: Path) -> None:
    actuator = loadmat(shared_data / "pneumatic_bending" / "OverLapMat.mat")["config"][0][0]
    x, y = np.ravel(actuator["x"]), np.ravel(actuator["y"])
    pressure = 1e-4 * np.ravel(actuator["p"])  # taken as hPa: the file does not say
    rows = [
        f"0,{k},{float(k)},{p},tip,{x[k]},,{y[k]},0.1,,0.1,{int(k > 0)}" for k, p in enumerate(pressure)
    ]
    (tmp_path / "targets.csv").write_text("\n".join([HEAD, *rows]) + "\n", encoding="utf-8")
    targets = read_targets(tmp_path, nodes={"tip": 1})
    assert targets.valid.sum() == 16  # eight pressures, two directions
    found = diagnose(cast(Any, None), (), targets, seed=0, start=np.zeros(2))
    assert found.verdict.startswith("cannot test: no noise model")
    assert found.named == ()
