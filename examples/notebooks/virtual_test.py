# %% [markdown]
# # Which film can tell which effects apart?
#
# Two effects that look alike in a film cannot be told apart, however small the noise. Which film makes them
# differ? A virtual test answers this before anything is filmed.
#
# Three tests of a small finger with three pleats are compared here. Protocol P1 films one marker in one ramp.
# P2 films five markers in the same ramp. P3 films five markers in two cycles with holds. [The virtual
# laboratory](../../docs/virtual-laboratory.md) explains all protocols.

# %%
import matplotlib.pyplot as plt
import numpy as np

import fe
from twin import Model, whitener_of
from twin.effects.library import effect
from twin.model.keptmodel import base_model
from twin.virtual.draws import Setup, at_nodes, measured
from twin.virtual.protocols import PROTOCOLS, places
from twin.virtual.truthsolves import displaced

finger = fe.Finger(length=43.3, bellows=3, tip_node=(43.3, 11.5, 0.0), middle_node=(20.6, 11.5, 0.0))
lattice = fe.Lattice(per_bellow=2, ring=False, centred=False)  # coarse, and so quick
C10, C01 = 0.214, 0.083  # MPa
NAMES = ["creep", "pressure_lag", "precurvature", "tube", "camera_rotation", "clamp"]
NAMES += ["wall_taper", "pressure_offset"]

# %% [markdown]
# ## What each test films
# The pressure is the same in all three until the ramp ends. P3 goes on with holds and a second, faster cycle.

# %%
figure, axes = plt.subplots(figsize=(8, 2.4), layout="constrained")
for name, label, width in (("P3", "P3", 1.5), ("P1", "P1 and P2", 3.0)):
    course = PROTOCOLS[name].course
    axes.plot(course.time, 1e3 * course.pressure, label=label, lw=width)
axes.set(xlabel="time, s", ylabel="pressure, kPa")
axes.legend()
plt.show()

# %% [markdown]
# ## How an effect would show
# The model is asked for its derivative by the first parameter of each effect. Divided by the noise, and apart
# from what other C10 and C01 could imitate, this is the effect's signature.


# %%
def signatures(name):
    """The signature (values,) of every effect in a protocol, in sds of the noise per unit."""
    protocol, where = PROTOCOLS[name], places(finger)
    names = [*[n for n in where if n.startswith("p")][1 : protocol.along], "tip"]
    wanted = np.array([where[n] for n in names])
    case = fe.finger_case(fe.Material(C10, C01), finger=finger, lattice=lattice)
    node = np.linalg.norm(case.nodes[:, None] - wanted, axis=2).argmin(axis=0)
    points = at_nodes(names, case.labels[node], case.nodes[node])
    u, slope = displaced(case, protocol.course, case.nodes[node], count=8)  # mm; mm per MPa
    targets = measured(protocol, u, slope, points=points, setup=Setup(), seed=0)

    base = base_model(targets, case)
    model = Model(base.test, (*base.effects, *map(effect, NAMES)), reference=targets.reference)
    given = {"C10": C10, "C01": C01, "creep.tau1": 4.0, "tube.place": 0.75}
    theta = model.theta({p.name: p.null for p in model.parameters} | given)
    w = whitener_of(base, np.array([C10, C01]), targets)
    rows = dict(zip([p.name for p in model.parameters], w.whiten(model.jacobian(theta))))
    constants = np.array([rows.pop("C10"), rows.pop("C01")]).T
    first = {n: next(row for key, row in rows.items() if key.startswith(f"{n}.")) for n in NAMES}
    return {n: z - constants @ np.linalg.lstsq(constants, z)[0] for n, z in first.items()}


found = {name: signatures(name) for name in ("P1", "P2", "P3")}

# %% [markdown]
# ## Who looks like whom
# A square says which share of the row's signature the column's can imitate: 1 is yellow, and no such film
# tells the two apart. White: the effect does not show at all.

# %%
figure, panels = plt.subplots(1, 3, figsize=(10, 4.4), layout="constrained", sharey=True)
alike = {}
for axes, (name, rows) in zip(panels, found.items()):
    size = {n: np.linalg.norm(z) for n, z in rows.items()}
    seen = np.array([rows[n] / size[n] if size[n] > 1e-6 else np.full(len(rows[n]), np.nan) for n in NAMES])
    alike[name] = (seen @ seen.T) ** 2
    drawn = axes.imshow(alike[name], vmin=0.0, vmax=1.0)
    axes.set(title=name, xticks=range(len(NAMES)), yticks=range(len(NAMES)), yticklabels=NAMES)
    axes.set_xticklabels(NAMES, rotation=60, ha="right")
figure.colorbar(drawn, ax=panels, label="share that is imitated", shrink=0.7)
plt.show()

# %%
for one, other in (("precurvature", "camera_rotation"), ("precurvature", "tube"), ("creep", "pressure_lag")):
    at = NAMES.index(one), NAMES.index(other)
    shares = ", ".join(f"{name} {100 * a[at]:.0f} %" for name, a in alike.items())
    print(f"{one} and {other} look alike: {shares}")

# %% [markdown]
# - **P1**: one marker in one ramp. Most effects of shape look the same in it.
# - **P2**: five markers tell shapes apart that one marker cannot.
# - **P3**: five markers with holds also tell what depends on time from what depends on shape.
# - **clamp** shows in none of them: without weight, nothing turns a soft clamp. P4 and P5 weigh the finger
#   and turn it.

# %% [markdown]
# ## The same with a whole diagnosis
# `twin virtual` makes a project of such a test with a hidden effect, to be calibrated and diagnosed as a film
# is. [Here](../../docs/virtual-laboratory.md#a-tie-that-a-second-film-resolves) one marker gives a tie that
# five resolve.
