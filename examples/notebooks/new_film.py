# %% [markdown]
# # From a new film to the missing effect
#
# A finger was filmed for eight seconds while its pressure rose and fell. What does the film say about the
# silicone, and which physical effect does a plain model of the finger lack?
#
# With a film of your own, begin at "Open the project": `twin init my-batch` makes the folder, and [your own
# test](../../docs/your-own-test.md) says what goes into it.

# %%
import shutil
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Image

import twin
from twin.project.folder import dataset

# %% [markdown]
# ## A folder with a film
# [datasets/quick](../../datasets/quick/README.md) holds a film, a static film, pictures of the calibration
# board, the pressure log and twin.toml. The copy is made in a new folder, so nothing is overwritten.

# %%
folder = Path(tempfile.mkdtemp()) / "short-finger"
shutil.copytree(dataset("quick"), folder)
sorted(path.relative_to(folder).as_posix() for path in folder.glob("*/*"))

# %% [markdown]
# Two constants need no long search: four generations of the genetic algorithm will do here, of 20. Least
# squares then carries the fit to its end.

# %%
config = folder / "twin.toml"
_ = config.write_text(config.read_text().replace("generations = 20", "generations = 4"))

# %% [markdown]
# ## Open the project
# `check` says what is missing, wrong or doubtful, and which command comes next.

# %%
batch = twin.open_project(folder)
print(batch.check())

# %% [markdown]
# ## From pixels to millimetres
# The board's pictures give the lens. Then every marker is followed through the film, and its place becomes a
# displacement in mm with its sd.

# %%
print(batch.camera())
measured = batch.measure()
print(measured)

# %% [markdown]
# Is every marker where it should be? Each line is the path of one marker.

# %%
Image(measured.folder / "overlay.png")

# %% [markdown]
# The table has one row for each step and point.

# %%
table = batch.targets.to_pandas()
table.groupby("point")[["u1_mm", "u3_mm"]].min().round(2)

# %% [markdown]
# ## Calibrate and compare
# Two constants of the silicone are fitted. Where the model does not fit, no interval is given.

# %%
batch.calibrate().to_pandas()[["parameter", "value", "unit", "note"]]

# %%
misfit = batch.compare().to_pandas()
misfit[misfit["by"] == "marker"][["name", "rms_mm", "noise_sd_mm", "ratio"]].round(3)

# %% [markdown]
# A ratio far above 1 is lack of fit: the model misses the markers by more than the noise. Something is
# missing.

# %% [markdown]
# ## Name what is missing
# Every [effect](../../docs/effects.md) of the library is tried. The best ones join the model, and everything
# is fitted again.

# %%
found = batch.diagnose()
print(found)

# %% [markdown]
# ## Add it
# The constants are fitted again with the effect, and now have 95 % intervals.

# %%
batch.add().to_pandas()[["parameter", "value", "low_95", "high_95", "unit"]].round(4)

# %% [markdown]
# The same comparison as before, with the effect in the model:

# %%
after = batch.compare().to_pandas()
before, after = (rows[rows["by"] == "marker"].set_index("name") for rows in (misfit, after))
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
place = np.arange(len(before))
axes.bar(place - 0.2, before["rms_mm"], 0.4, label="without the effect")
axes.bar(place + 0.2, after["rms_mm"][before.index], 0.4, label="with it")
axes.plot(place, after["noise_sd_mm"][before.index], "k_", ms=30, label="noise")
axes.set(xticks=place, xticklabels=before.index, ylabel="error, mm rms")
axes.legend()
plt.show()

# %% [markdown]
# ## What next
# `batch.predict("20kPa")` foretells a pressure that nobody has filmed, `batch.review()` writes the report and
# the recording for rerun. Both stand in [Python](../../docs/python.md).
