"""A finger in MuJoCo, as a program that is not ours: a chain of hinges and slides with springs and weight,
bent and stretched by the pressure of a chamber off its axis.

Where it stands still is found by MuJoCo's inverse dynamics: the forces that hold a chain at rest in a place
are those of pressure. `pip install mujoco`.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PLACES = {"a": (25.0, 0.0, 2.0), "b": (50.0, 0.0, -2.0), "c": (75.0, 0.0, 2.0), "tip": (100.0, 0.0, -4.0)}
LENGTH, AREA, SECOND_MOMENT = 100.0, 300.0, 9000.0  # mm, mm2, mm4 of the section
CHAMBER, OFF_AXIS = 60.0, 7.0  # mm2, mm
DENSITY, GRAVITY = 1.07e-9, 9810.0  # t/mm3, mm/s2
SWEEPS, STILL, MOST = 60, 1e-8, 0.2  # of the equilibrium; steps in rad and mm: the last one, the largest
LEVELS = 25  # of the pressure, between which answers are interpolated


@lru_cache(maxsize=3)
def chain(links: int) -> Any:
    """The model of a chain, in mm, t, s, N, with a site at each place; hinges are in the middle of links."""
    import mujoco

    h = LENGTH / links
    ends = {round(x / h): (name, z) for name, (x, _, z) in PLACES.items()}
    inside = ""
    for k in range(links, 0, -1):
        name, z = ends.get(k, ("", 0.0))
        site = f'<site name="{name}" pos="{h / 2:.17g} 0 {z}"/>' if name else ""
        inside = (
            f'<body pos="{h if k > 1 else h / 2:.17g} 0 0"><joint type="hinge" axis="0 1 0"/>'
            f'<joint type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="{DENSITY * AREA * h}" '
            f'diaginertia="1e-6 1e-6 1e-6"/>{site}{inside}</body>'
        )
    option = f'<option gravity="0 0 {-GRAVITY}"/><compiler boundmass="0" boundinertia="0"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{inside}</worldbody></mujoco>")


def displaced(values: dict[str, float], pressure: Array, *, parts: int = 100) -> Array:
    """Displacements (s, 4, 3) mm at pressures (s,) MPa, of E in MPa and taper, from those of the chain
    without pressure; parts: 100 of 20 links, 200 of 40, others of 60. ImportError without MuJoCo."""
    import mujoco
    from scipy.interpolate import CubicSpline

    links = {100: 20, 200: 40}.get(parts, 60)
    model, h, E = chain(links), LENGTH / links, values["E"]
    softer = 1 - values.get("taper", 0.0) * (2 * (np.arange(links) + 0.5) / links - 1)
    spring = np.ravel([E * SECOND_MOMENT / h / softer, np.full(links, E * AREA / h)], order="F")
    data, tangent = mujoco.MjData(model), np.zeros((2 * links, 2 * links))
    levels, places = np.linspace(min(pressure.min(), 0.0), pressure.max() + 1e-9, LEVELS), []
    for p in levels:
        given = np.tile([p * CHAMBER * OFF_AXIS, p * CHAMBER], links)
        for _ in range(SWEEPS):
            data.qvel[:] = data.qacc[:] = 0.0
            mujoco.mj_inverse(model, data)  # what holds the chain against its weight
            left = given - data.qfrc_inverse - spring * data.qpos
            mujoco.mjd_inverseFD(model, data, 1e-6, False, tangent, *[None] * 6)
            step = np.linalg.solve(tangent.T + np.diag(spring), left)
            data.qpos += step * min(1.0, MOST / np.abs(step).max())
            if np.abs(step).max() < STILL:
                break
        else:
            raise ValueError(f"MuJoCo: a chain of E = {E:.3g} MPa finds no rest at {p:.3g} MPa")
        mujoco.mj_kinematics(model, data)
        places.append([data.site(name).xpos.copy() for name in PLACES])
    u = CubicSpline(levels, np.array(places))(np.append(pressure, 0.0))
    return np.asarray(u[:-1] - u[-1])
