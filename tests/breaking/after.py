"""Faults of what stays behind after the load: flow, energy, conductance."""

import numpy as np
from scipy.ndimage import label
from scipy.special import itj0y0

from breaking.fault import Fault, at, changed, given, on_result, quantity
from epcontact.interface import Limit
from epcontact.materials.moduli import effective_modulus
from epcontact.reference.conductance import LAWS

FLOWED, INTERFACE = "epcontact.bem.flow.plastic_displacement", "epcontact.interface."


def _deepest(w):
    return np.where(w > np.median(w[w > 0]), w, 0.0)


def _on_the_deformed(original):
    def wrong(problem, solution, before):
        u = solution.displacement
        return original(problem, solution, before) + 0.1 * (u - u.min())

    return wrong


def _other_branch(result, branch):
    return result, {"loading": "unloading", "unloading": "loading"}[branch]


def _alone(original):
    """The displacement within half a period of a force, and none beyond: int_0^(qR) J_0
    of it.
    """

    def wrong(scene):
        modes, modulus = original(scene), effective_modulus(scene.material)
        reach = (
            scene.surface.periods[0] / modulus / np.where(modes > 0, modes, np.inf)
        )  # q R
        return modes * itj0y0(reach)[0]

    return wrong


def _law(name, wrong):
    """A law of conductance in the place of its own."""
    return lambda monkeypatch: monkeypatch.setitem(LAWS, name, wrong)


def _without_the_period(mask, diagonals):
    """Number the patches of a mask whose edges are free."""
    return label(mask)[0][mask] - 1, False


FAULTS = (
    Fault(
        "the residual surface from half of the points that flowed",
        "bem",
        on_result(FLOWED, _deepest),
        "cycle-unloaded",
        "quantity.path_work",
    ),
    Fault(
        "a reload on the deformed surface",
        "bem",
        changed(FLOWED, _on_the_deformed),
        "cycle-capped",
        "quantity.path_work",
    ),
    Fault(
        "the plastic work halved",
        "bem",
        quantity("epcontact.bem.solve", "plastic_work", lambda work: work / 2),
        "cycle-capped",
        "quantity.measured_figures",
    ),
    Fault(
        "a factor of 2 in the conductance",
        "interface",
        on_result(
            INTERFACE + "contact_conductance", lambda k: Limit(*(v / 2 for v in k))
        ),
        "rough-interface",
        "quantity.conductance",
    ),
    Fault(
        "a correction of the conductance of the wrong sign",
        "interface",
        on_result(
            INTERFACE + "stiffness.limit_of",
            lambda k: k._replace(corrected=k.raw**2 / k.corrected),
        ),
        "punch-strip",
        "quantity.conductance",
    ),
    Fault(
        "a contact without its periodic images",
        "interface",
        changed(INTERFACE + "punch.compliance", _alone),
        "rough-interface",
        "quantity.conductance",
    ),
    Fault(
        "a conductance that claims a tenth of its error",
        "interface",
        on_result(
            INTERFACE + "stiffness.limit_of", lambda k: k._replace(error=k.error / 10)
        ),
        test="tests/test_interface.py::test_claims_cover_the_errors_of_limits",
    ),
    Fault(
        "a conductance of insulating plastic spots",
        "interface",
        given(INTERFACE + "stiffness.carrying", _other_branch),
        "rough-interface",
        "quantity.conductance",
    ),
    Fault(
        "the stiffness of the other branch",
        "interface",
        given(INTERFACE + "stiffness.carrying", _other_branch),
        "punch-capped",
        "quantity.stiffness_loading",
    ),
    Fault(
        "the plastic work of J2 10 % too low",
        "fem_check",
        quantity(
            "epcontact.harness.methods.registry.contact_result",
            "plastic_work",
            lambda work: 0.9 * work,
        ),
        "cycle-j2",
        "quantity.path_work",
    ),
    Fault(
        "patches that do not join over the period",
        "interface",
        at(INTERFACE + "percolation.number_patches", _without_the_period),
        test="tests/test_interface.py::test_patches_join_over_the_period",
    ),
    Fault(
        "the exponent of the law for flow 0.85",
        "reference",
        _law("Cooper-Mikic-Yovanovich", lambda load, hardness: 1.25 * load**0.85),
        "conductance-plastic",
        "quantity.conductance",
        "cooper_mikic_yovanovich",
    ),
    Fault(
        "the rms slope in the place of a profile's mean slope",
        "reference",
        at("epcontact.reference.conductance.PROFILE", 1.0),
        "conductance-plastic",
        "quantity.conductance",
        "cooper_mikic_yovanovich",
    ),
    Fault(
        "the height in the place of the slope",
        "reference",
        at(
            "epcontact.reference.conductance.slope_of",
            lambda scene: scene.surface.rms_height,
        ),
        "conductance-elastic",
        "quantity.conductance",
        "mikic",
    ),
)
