# %% [markdown]
# # A model in plain numpy is told that its regulator lags
#
# You have a model of your own: a formula, a rod, another simulator. It does not follow the measurement. Is
# the model too simple, or is something wrong with the rig? softtwin asks the model as it is, fits its
# parameters and says which effect is missing. Nothing of its inside is needed.
#
# The measurement is made here, so that the truth is known: the pressure in the finger follows the log 0.3 s
# late, and every value has noise of 0.05 mm.

# %%
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import twin

PLACES = {"a": (35, 0, 0), "b": (70, 0, 2), "tip": (100, 0, -4)}  # mm, along x from the clamp


def predict(values, pressure):
    """Displacements (steps, points, 3) mm at pressures (steps,) MPa: a rod that bends in one arc."""
    x, _, z = np.array(list(PLACES.values()), float).T
    k = np.maximum(values["bending"] * pressure, 1e-9)[:, None]  # curvature, 1/mm
    along, up = np.sin(k * x) / k + z * np.sin(k * x), (np.cos(k * x) - 1) / k + z * np.cos(k * x)
    return np.stack([along - x, 0 * along, up - z], axis=2)


# %% [markdown]
# ## The measurement
# The pressure rises, is held, falls to a third, and rises again. A row is a moment; the log is finer.

# %%
def course(t):
    return np.interp(t, [0, 3, 8, 14, 16, 20, 24, 28, 33], [0, 0, 0.03, 0.03, 0.01, 0.01, 0.03, 0.03, 0.0])


steps, fine = np.arange(0.0, 33.0, 0.5), np.arange(0.0, 33.0, 0.01)  # s
late = np.zeros(len(fine))
for n in range(1, len(fine)):
    late[n] = late[n - 1] + 0.01 / 0.3 * (course(fine)[n - 1] - late[n - 1])
u = predict({"bending": 0.5}, np.interp(steps, fine, late))
u += 0.05 * np.random.default_rng(1).standard_normal(u.shape)

table = pd.DataFrame({"time_s": steps, "pressure_kPa": 1e3 * course(steps)})
for k, name in enumerate(PLACES):
    table[f"{name}_x_mm"], table[f"{name}_z_mm"] = u[:, k, 0], u[:, k, 2]
log = pd.DataFrame({"time_s": fine, "pressure_kPa": 1e3 * course(fine)})
data = twin.read_table(table, points=PLACES, sd_mm=0.05, log=log)
data

# %% [markdown]
# ## The model as it is
# `twin.simulator` takes the function and its parameters: name, lowest and highest value, unit, and a start.
# Every run is made once.

# %%
bending = twin.Parameter("bending", 0.05, 2.0, "1/(mm MPa)", start=0.4)
mine = twin.simulator(predict, [bending])
found = twin.diagnose(mine, data)
print(found)

# %%
len(mine.runs)

# %% [markdown]
# The fall of the pressure gives it away. With the best bending alone the rest is large wherever the pressure
# moves, and 0 where it is held; with the lag only noise is left.

# %%
base, kept = found.diagnosis.base, found.diagnosis.kept
figure, axes = plt.subplots(figsize=(8, 3.8), layout="constrained")
tip = data.names.index("tip")
for label, fit in (("bending alone", base), ("with pressure_lag", kept)):
    rest = data.value - fit.model.predict(fit.fit.theta)  # (steps, points, 3) mm
    axes.plot(data.time, rest[:, tip, 2], ".-", label=label)
axes.plot(data.time, 100 * data.pressure, color="0.8", label="pressure, 10 kPa")
axes.set(xlabel="time, s", ylabel="measured less predicted, tip U3, mm")
axes.legend()
plt.show()

# %% [markdown]
# The model itself is right. Without the lag its parameter takes up a little of what is missing.

# %%
pd.DataFrame({
    "true": {"bending": 0.5, "pressure_lag.tau": 0.3}, "without the lag": base.values, "with it": kept.values
}).round(4)

# %% [markdown]
# [How do I use softtwin from Python](../../docs/python.md#a-model-of-your-own-or-another-simulator) says what
# else a program can be told, how a program that runs elsewhere is asked by a table, and what the verdicts of
# such programs are worth.
