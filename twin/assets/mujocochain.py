"""The rod as a chain of MuJoCo: a hinge with a slide for each section, with springs, in m, kg, s, N.

The pressure acts as moments and forces on all joints: those that hold the springs where the rod is. They are
a cubic of the pressure over the highest one, s, so the model has three controls: s, s^2 and s^3. A joint has
one stiffness, that of the rod at half of the highest pressure.
"""

from pathlib import Path
from typing import Any

import numpy as np

from twin.assets.rod import Rod
from twin.targets import Array

POWERS = 3  # of the pressure
STEP, MOST = 1e-3, 20.0  # s, and how long a finger may take to rest
STILL = 1e-7  # m/s and rad/s of a finger at rest
FILE, HIGHEST = "finger.xml", "highest_pressure_MPa"


def written(rod: Rod) -> dict[str, str]:
    """The text of finger.xml by its name."""
    s = rod.pressure / rod.pressure[-1]
    powers = s[:, None] ** np.arange(1, POWERS + 1)
    given = rod.bend, rod.length - rod.length[0]
    bend, stretch = (np.linalg.lstsq(powers, x, rcond=None)[0] for x in given)
    hinge, slide = 1e-3 * rod.stiffness_at(rod.middle), 1e3 * rod.pull_stiffness
    tendons = [
        f'    <fixed name="power{j + 1}">\n'
        + "\n".join(
            f'      <joint joint="bend{k + 1}" coef="{hinge[k] * bend[j, k]:.9g}"/>'
            f' <joint joint="stretch{k + 1}" coef="{1e-3 * slide[k] * stretch[j, k]:.9g}"/>'
            for k in range(len(hinge))
        )
        + "\n    </fixed>"
        for j in range(POWERS)
    ]
    motors = [f'    <motor name="power{j + 1}" tendon="power{j + 1}"/>' for j in range(POWERS)]
    top = 1e3 * rod.pressure[-1]
    return {FILE: "\n".join([
        f"<!-- A soft finger. Controls: s, s^2, s^3 with s = pressure / {top:.6g} kPa, from 0 to 1. -->",
        '<mujoco model="finger">',
        f'  <option timestep="{STEP:g}" integrator="implicitfast" gravity="0 0 0"/>',
        '  <compiler angle="radian"/>',
        f'  <custom><numeric name="{HIGHEST}" data="{rod.pressure[-1]:.9g}"/></custom>',
        "  <worldbody>", *_links(rod, hinge, slide), "  </worldbody>",
        "  <tendon>", *tendons, "  </tendon>",
        "  <actuator>", *motors, "  </actuator>",
        "</mujoco>", "",
    ])}  # fmt: skip


def _links(rod: Rod, hinge: Array, slide: Array) -> list[str]:
    """Lines of the nested bodies."""
    n, length = len(hinge), 1e-3 * rod.length[0]
    turn, damped = np.diff(rod.turns, prepend=0.0), rod.settling
    places = [1e-3 * rod.rest[0], *(np.array([x, 0.0, 0.0]) for x in length[:-1])]
    lines = []
    for k in range(n):
        pad, name = "  " * (k + 2), k + 1
        lines += [
            f'{pad}<body name="link{name}" pos="{_text(places[k])}" euler="0 {turn[k]:.9g} 0">',
            f'{pad}  <joint name="bend{name}" type="hinge" axis="0 1 0" stiffness="{hinge[k]:.9g}" '
            f'damping="{damped * hinge[k]:.9g}"/>',
            f'{pad}  <joint name="stretch{name}" type="slide" axis="1 0 0" stiffness="{slide[k]:.9g}" '
            f'damping="{damped * slide[k]:.9g}"/>',
            f'{pad}  <geom type="capsule" fromto="0 0 0 {length[k]:.9g} 0 0" size="0.005" '
            f'mass="{1e3 * rod.mass[k]:.9g}" contype="0" conaffinity="0"/>',
        ]
    lines += [f'{"  " * (n + 2)}<site name="tip" pos="{length[-1]:.9g} 0 0"/>']
    return lines + [f'{"  " * (k + 2)}</body>' for k in reversed(range(n))]


def _text(x: Array) -> str:
    return " ".join(f"{v:.9g}" for v in x)


def tips(folder: Path, pressures: Array, force: float = 0.0) -> Array:
    """Displacements (k, 3) mm of the tip of a finger.xml at rest under pressures (k,) MPa, with a force in N
    up there. ImportError without MuJoCo."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(folder / FILE))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start, top, out = data.site("tip").xpos.copy(), model.numeric(HIGHEST).data[0], []
    for p in pressures:
        data.ctrl[:] = (p / top) ** np.arange(1, POWERS + 1)
        _rest(mujoco, model, data, np.array([0.0, 0.0, force]))
        out.append(1e3 * (data.site("tip").xpos - start))
    return np.array(out)


def _rest(mujoco: Any, model: Any, data: Any, force: Array) -> None:
    """Steps until nothing moves."""
    last, began = model.body(f"link{model.nbody - 1}").id, data.time
    while data.time < began + MOST:
        data.qfrc_applied[:] = 0.0
        at = data.site("tip").xpos
        mujoco.mj_applyFT(model, data, force, np.zeros(3), at, last, data.qfrc_applied)
        mujoco.mj_step(model, data)
        if data.time > began + 0.1 and np.abs(data.qvel).max() < STILL:
            return
