# %% [markdown]
# # From displacements of another program to the missing effect
#
# You have displacements already: from DeepLabCut, Anipose, DICe, MatchID, motion capture or a spreadsheet.
# What is missing in a model of this finger? No film and no camera are needed here.
#
# The table below is computed, so that the truth is known: the pressure inside the finger lags behind the
# gauge by 1 s. With a table of your own, begin at "Read it".

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import fe
from twin import Model
from twin.diagnosis.procedure import diagnose
from twin.effects.library import effect
from twin.formats.catalogue import read_recorded
from twin.formats.conversion import targets_of
from twin.formats.importtable import ImportTable
from twin.marktables import PointTable
from twin.model.keptmodel import base_model

folder = Path(tempfile.mkdtemp())
SD, LAG = 0.02, 1.0  # mm, of one value; s

# %% [markdown]
# ## A table
# A finger of 43.3 mm with three pleats is inflated to 30 kPa, held and emptied. One row is one moment.

# %%
finger = fe.Finger(length=43.3, bellows=3, tip_node=(43.3, 11.5, 0.0), middle_node=(20.6, 11.5, 0.0))
log = np.arange(0.0, 20.05, 0.1)  # s
gauge = 0.03 * np.interp(log, [0, 2, 6, 12, 16], [0, 0, 1, 1, 0])  # MPa
inside, keep = np.zeros_like(gauge), np.exp(-0.1 / LAG)
for k in range(1, len(log)):
    inside[k] = keep * inside[k - 1] + (1 - keep) * (gauge[k - 1] + gauge[k]) / 2

time = np.arange(0.0, 20.5, 1.0)  # s
at = np.array([finger.tip_node, finger.middle_node])
lattice = fe.Lattice(per_bellow=2, centred=False)  # another mesh than the model's
case = fe.finger_case(fe.Material(0.214, 0.083), finger=finger, lattice=lattice)
u = fe.solve(case, fe.Path(log, inside, time)).at(at)
u += SD * np.random.default_rng(1).standard_normal(u.shape)  # (moments, points, 3) mm

table = pd.DataFrame({"time_s": time, "pressure_kPa": 1e3 * np.interp(time, log, gauge)})
for k, name in enumerate(("tip", "middle")):
    table[f"{name}_x_mm"], table[f"{name}_z_mm"] = u[:, k, 0], u[:, k, 2]
table.round(3).to_csv(folder / "own.csv", index=False)
table.iloc[::4].round(3)

# %% [markdown]
# ## Read it
# [Files](../../docs/files.md#files-of-other-programs) has the formats that are read. `sd_mm` says how exact
# one value is. A point is named as in the table; its node is the place on the model.

# %%
points = [PointTable(name="tip", node=4401), PointTable(name="middle", node=5848)]
stated = ImportTable(file="own.csv", format="csv", sd_mm=SD)
targets = targets_of(read_recorded(folder / "own.csv", "csv"), stated, points)[0]
targets.to_pandas().groupby("point")[["u1_mm", "u3_mm"]].min().round(2)

# %% [markdown]
# ## Calibrate, and name what is missing
# The model is a finger with two constants of its silicone, on a coarse mesh, so that this page runs in
# seconds. Three effects are tried here.

# %%
coarse = fe.Lattice(per_bellow=2, ring=False, centred=False)
model = base_model(targets, fe.finger_case(fe.Material(), finger=finger, lattice=coarse))
tried = [effect(name) for name in ("pressure_lag", "pressure_offset", "camera_scale")]
found = diagnose(model, tried, targets, seed=0, start=np.array([0.2, 0.1]), beside=())
print(found.sentence)

# %%
fit = found.kept.fit
low, high = fit.interval(0.95).T
pd.DataFrame({"value": fit.theta, "low_95": low, "high_95": high}, [q.name for q in fit.parameters]).round(3)

# %% [markdown]
# The lag of 1 s was put in by hand, and so were C10 = 0.214 and C01 = 0.083 MPa.

# %% [markdown]
# ## The error, before and after
# The calibrated model without the effect misses the tip while the pressure changes. With it, noise is left.

# %%
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for label, judged in (("without the lag", found.base), ("with it", found.kept)):
    effects = (*model.effects, *(found.effects if judged is found.kept else ()))
    predicted = Model(model.test, effects, reference=targets.reference).predict(judged.fit.theta)
    axes.plot(targets.time, (targets.value - predicted)[:, 0, 2], "o-", label=label)
axes.set(xlabel="time, s", ylabel="measured - model, U3 of the tip, mm")
axes.legend()
plt.show()

# %% [markdown]
# ## The same as a project
# A folder keeps every run, tries all effects and uses a finer mesh. For a finger of 80 mm:
#
#     twin init my-own --targets own.csv --finger length_mm=80 --sd-mm 0.02 --node tip=80,11.5,0
#     twin measure -p my-own
#     twin calibrate -p my-own
#     twin diagnose -p my-own
