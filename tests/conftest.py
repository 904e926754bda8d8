"""The small case that several tests write."""

import os

import pytest
from hypothesis import settings

settings.register_profile("without a clock", deadline=None)
settings.load_profile("without a clock")
os.environ.pop("PYTHONUNBUFFERED", None)  # users' output is buffered
# Workers of xdist share the cores, and threads of numpy's linear algebra wait by
# spinning.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when numpy is loaded

SMALL_CASE = """
[case]
id = "small"
requirement = "The boundary elements and the theory answer a small scene."
source = "made for the tests"
methods = ["persson", "bem"]

[surface]
kind = "self_affine"
period = 1.0e-3
hurst = 0.8
wavenumber_low = 6.283185307179586e3
wavenumber_roll_off = 1.2566370614359173e4
wavenumber_high = 5.026548245743669e4
rms_slope = 0.1
points_per_shortest_wavelength = { fast = 4, full = 8 }
seeds = [3, 5, 7]

[material]
young_modulus = 100.0e9
poisson_ratio = 0.3
hardness = 6.0e9

[theory]
energy_reduction = 0.536

[load]
mean_pressure = 5.0e8

[[gate]]
quantity = "area.total.corrected"
of = "bem"
against = "persson"
tolerance = 0.5
because = "only a smoke test"
"""
#: Its surface.
ROUGH = SMALL_CASE.partition("[surface]\n")[2].partition("\n\n")[0]
#: What makes SMALL_CASE a family of two.
VARIANTS = """
[[variant]]
case = { id = "soft" }
material = { young_modulus = 50.0e9 }

[[variant]]
case = { id = "stiff", requirement = "A stiff one." }
[[variant.gate]]
quantity = "area.total.corrected"
tolerance = 0.1
because = "It is stiff."

[[variant.gate]]
quantity = "quantity.mean_gap"
of = "bem"
against = "persson"
tolerance = 2
because = "-"
"""


@pytest.fixture
def write_case(tmp_path):
    """Return a function that writes SMALL_CASE to a new file in `tmp_path` and returns
    its path.
    """

    def write(*replacements, name="small", more=""):
        """Write SMALL_CASE with changes to `name`.toml, and return the path of the
        file.

        `replacements` are pairs (old text, new text), applied in order; an old text
        that is absent fails the test. `name` is also the id of the case, and `more` is
        appended to the file.
        """
        text = SMALL_CASE.replace('id = "small"', f'id = "{name}"') + more
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        return path

    return write
