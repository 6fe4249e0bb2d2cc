"""A calibrated soft finger as a chain of Newton: m, kg, s, N.

    python finger_newton.py 0.01 0.02     tips at these pressures in MPa

It reads rod.json from its own folder. Each section is a hinge and a slide with drives; the pressure is where
they drive to, and how stiff they are. Nothing turns across the plane or about the axis.
"""

import json
import sys
from pathlib import Path

import newton
import numpy as np
import scipy
import warp as wp
from numpy.typing import NDArray

STEP, MOST = 1e-3, 20.0  # s, and how long a finger may take to rest
CHECK, STILL = 50, 1e-7  # steps between looks, and m by which a finger at rest still moves in them


class NewtonFinger:
    """The chain of a rod.json under a pressure in MPa."""

    def __init__(self, folder: Path, pressure: float) -> None:
        data = json.loads((folder / "rod.json").read_text(encoding="utf-8"))
        rod = {name: np.array(x, float) for name, x in data.items() if isinstance(x, list)}
        bend, length, hinge = (
            scipy.interpolate.CubicSpline(rod["pressure"], rod[name])(pressure)
            for name in ("bend", "length", "bend_stiffness")
        )
        step = np.diff(rod["rest"], axis=0)
        turn = np.diff(np.unwrap(np.arctan2(-step[:, 2], step[:, 0])), prepend=0.0)
        self.at_rest, self.last = 1e-3 * rod["rest"][-1], 1e-3 * float(rod["length"][0, -1])
        self.builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        self.bodies, joints, place = [-1], [], 1e-3 * rod["rest"][0]
        damped = float(data["settling"])
        for k, long in enumerate(1e-3 * rod["length"][0]):
            mass = 1e3 * float(rod["mass"][k])
            for slides in (False, True):
                half = wp.mat33(np.diag([mass / 2 * long**2 / 12] * 3))  # of the mass: both move together
                link = self.builder.add_link(mass=mass / 2, com=wp.vec3(long / 2, 0.0, 0.0), inertia=half)
                ke = 1e3 * float(rod["pull_stiffness"][k]) if slides else 1e-3 * float(hinge[k])
                about = wp.quat_from_axis_angle(wp.vec3(0.0, 1.0, 0.0), 0.0 if slides else float(turn[k]))
                start = wp.transform(wp.vec3() if slides else wp.vec3(*place), about)
                drive = {"target_ke": ke, "target_kd": damped * ke, "parent_xform": start}
                joint = self.builder.add_joint_prismatic if slides else self.builder.add_joint_revolute
                to = 1e-3 * (length[k] - rod["length"][0, k]) if slides else bend[k]
                axis = newton.Axis.X if slides else newton.Axis.Y
                joints.append(joint(self.bodies[-1], link, axis=axis, target_q=float(to), **drive))
                self.bodies.append(link)
            place = np.array([long, 0.0, 0.0])
        self.builder.add_articulation(joints)

    def tip(self, force: float = 0.0) -> NDArray[np.float64]:
        """Displacement (3,) mm of the tip at rest, with a force in N up there."""
        model = self.builder.finalize()
        solver = newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True, integrator="implicitfast")
        now, then, control = model.state(), model.state(), model.control()
        newton.eval_fk(model, model.joint_q, model.joint_qd, now)
        load, before = np.zeros((model.body_count, 6), np.float32), np.full(3, np.inf)
        for step in range(int(MOST / STEP)):
            if step % CHECK == 0:
                at, middle = self._tip(now)
                if np.abs(at - before).max() < STILL:
                    break
                before = at
                load[-1] = *(0.0, 0.0, force), *np.cross(at - middle, [0.0, 0.0, force])
            now.body_f.assign(load)
            solver.step(now, then, control, None, STEP)
            now, then = then, now
        return np.asarray(1e3 * (at - self.at_rest))

    def _tip(self, state: "newton.State") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Places (3,) m of the tip and of the last link's middle."""
        pose = wp.transform(*state.body_q.numpy()[-1])
        along = (self.last, self.last / 2)
        at, middle = (np.array(wp.transform_point(pose, wp.vec3(x, 0.0, 0.0))) for x in along)
        return at, middle


def tips(folder: Path, pressures: NDArray[np.float64], force: float = 0.0) -> NDArray[np.float64]:
    """Displacements (k, 3) mm of the tip at rest under pressures (k,) MPa, with a force in N up there."""
    with wp.ScopedDevice("cpu"):
        return np.array([NewtonFinger(folder, float(p)).tip(force) for p in pressures])


if __name__ == "__main__":
    asked = [float(x) for x in sys.argv[1:]]
    for p, u in zip(asked, tips(Path(__file__).parent, np.array(asked)), strict=True):
        print(f"{1e3 * p:.3g} kPa: tip {u[0]:.3f}, {u[1]:.3f}, {u[2]:.3f} mm")
