# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""D of a tree must be positive definite: its Cholesky factor, and the joints that move no mass.

SciPy's BLAS and LAPACK, loaded when the first of them is called.

That takes a third of a second, which a node that starts again does not have, and kernels never call
them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import HapticMechError, InaccurateStepError
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene


def dtrsm(*arguments: Any, **options: Any) -> Any:
    """Return the solution of a triangular system for a matrix; see ``scipy.linalg.blas.dtrsm``."""
    from scipy.linalg.blas import dtrsm as solve

    return solve(*arguments, **options)


def dtrsv(*arguments: Any, **options: Any) -> Any:
    """Return the solution of a triangular system for a vector; see ``scipy.linalg.blas.dtrsv``."""
    from scipy.linalg.blas import dtrsv as solve

    return solve(*arguments, **options)


# A joint's inertia is rounding below this fraction of its mass's at the mechanism's length.
NO_INERTIA = 1e-15


NO_MASS = "no link has a mass: give the links that move one, with an inertia"


class SingularInertiaError(HapticMechError):
    """D is not positive definite: some joint moves no mass.

    Attributes:
        rate: first degree of freedom at which D is not.
    """

    def __init__(self, message: str, rate: int) -> None:
        super().__init__(message)
        self.rate = rate


def cholesky_of_upper(inertia_upper: Array) -> Array:
    """Return the lower factor L (nv, nv) of D, L Lᵀ = D, given D's upper triangle.

    Args:
        inertia_upper: (nv, nv) D, kg, kg m and kg m², of which the upper triangle is read.

    Raises:
        SingularInertiaError: D is not positive definite.
    """
    from scipy.linalg.lapack import dpotrf

    upper, info = dpotrf(inertia_upper, lower=0, clean=1)
    if info != 0:
        raise SingularInertiaError(
            f"joint-space inertia is not positive definite at degree of freedom {info - 1}: "
            "every joint must move some mass",
            info - 1,
        )
    return np.asarray(upper.T)


def singular_joint(tree: TreeModel, rate: int) -> SingularInertiaError:
    """Return the error of a configuration at which D is not positive definite at ``rate``."""
    index = _joint_of(tree, rate)
    message = f"joint {tree.joint_names[index]!r} moves no mass that others do not move as well"
    return SingularInertiaError(f"{message}: {_remedy(tree, index)}", rate)


def diverged(tree: TreeModel, moved: Array, step: float) -> HapticMechError:
    """Return the error of a step that went astray.

    Args:
        tree: the mechanism's.
        moved: (nv,) rad or m, how far a stage of it is from its start.
        step: s.
    """
    rate = int(np.argmax(np.abs(moved)))
    joint = tree.joint_names[_joint_of(tree, rate)]
    return HapticMechError(
        f"the step diverged: joint {joint!r} moved by {moved[rate]:.3g} rad or m in {step:.3g} s; "
        "a shorter period or more substeps are needed"
    )


def inaccurate(tree: TreeModel, change: Array, off: float, exchanged: float) -> InaccurateStepError:
    """Return the error of a step whose energy account is off by too much.

    Args:
        tree: the mechanism's.
        change: (nv,) of the rates, rad/s or m/s.
        off: J, by which it is.
        exchanged: J, energy that the step exchanged.
    """
    rate = int(np.argmax(np.abs(change)))
    return InaccurateStepError(tree.joint_names[_joint_of(tree, rate)], off, exchanged)


def _joint_of(tree: TreeModel, rate: int) -> int:
    return next(i for i in range(len(tree.joints)) if tree.velocity_slice(i).stop > rate)


def is_massless(scene: Scene) -> bool:
    """Return whether no link of a scene has a mass: it can be drawn only."""
    return not any(link.inertial.mass for link in scene.links)


def refuse_massless(tree: TreeModel, length: float) -> None:
    """Check that every joint moves mass or inertia somewhere.

    A joint's part of D is analytic in q: where it is singular at a configuration that nothing
    singles out, it is so everywhere.

    Args:
        tree: the mechanism's.
        length: unit of angular rates, m.

    Raises:
        SingularInertiaError: a joint moves none at any configuration; names joint and link.
    """
    model = tree.pinocchio
    data = model.createData()
    somewhere = np.cos(1.0 + 1.7 * np.arange(model.nv))
    q = pin.integrate(model, pin.neutral(model), somewhere)
    inertia = np.triu(pin.crba(model, data, q).reshape(model.nv, model.nv))
    pin.computeSubtreeMasses(model, data)
    for index, kind in enumerate(tree.joint_types):
        part = tree.velocity_slice(index)
        units = length ** np.array(ANGULAR[kind])
        block = inertia[part, part] / np.outer(units, units)
        least = np.linalg.eigvalsh(block, UPLO="U")[0]
        if least <= NO_INERTIA * data.mass[index + 1]:
            message = f"joint {tree.joint_names[index]!r} moves no mass: {_remedy(tree, index)}"
            raise SingularInertiaError(message, part.start)


# 1 for angular rates of a joint, 0 for linear ones.
ANGULAR: dict[str, tuple[float, ...]] = {
    "revolute": (1.0,),
    "prismatic": (0.0,),
    "spherical": (1.0, 1.0, 1.0),
    "free": (0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
    "planar": (0.0, 0.0, 1.0),
}


def _remedy(tree: TreeModel, index: int) -> str:
    link = tree.links[index]
    return f"give link {link!r} or one of its children a mass or inertia, or lock the joint"
