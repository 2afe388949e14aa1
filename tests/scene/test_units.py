"""A figure with its unit is refused with the figure in SI units that would do."""

import pytest

from graspless_pin.scene.units import si_advice


@pytest.mark.parametrize(
    ("found", "location", "advice"),
    [
        ("300 g", ("object", "mass"), "write 0.3 (kg), without 'g'"),
        ("300g", ("object", "mass"), "write 0.3 (kg), without 'g'"),
        ("60 mm", ("object", "shape", "size", 0), "write 0.06 (m), without 'mm'"),
        ("6 cm", ("object", "pose", "position", 2), "write 0.06 (m), without 'cm'"),
        ("2 in", ("object", "shape", "radius"), "write 0.0508 (m), without 'in'"),
        ("1.2 g/cm3", ("object", "density"), "write 1200 (kg/m^3), without 'g/cm3'"),
        ("1200 kg/m³", ("object", "density"), "write 1200, without 'kg/m³'"),
        ("500 mN m", ("hand", "effort_limits", "thumb"), "write 0.5 (Nm), without 'mN m'"),
        ("0.5 N·m", ("hand", "effort_limits", "thumb"), "write 0.5, without 'N·m'"),
        ("9.81 m/s2", ("gravity", 2), "write 9.81, without 'm/s2'"),
        ("90 deg", ("object", "pose", "rpy", 1), "write 1.57079632679 (rad), without 'deg'"),
        ("90°", ("object", "pose", "rpy_deg", 1), "write 90, without '°'"),
        ("1 rad", ("hand", "q_deg", "hinge"), "write 57.2957795131 (deg), without 'rad'"),
        ("2 mm", ("contact_tolerance",), "write 0.002 (m), without 'mm'"),
        ("2 mm", ("max_penetration",), "write 0.002 (m), without 'mm'"),
        ("300 mm", ("object", "mass"), "give the number without 'mm': units are SI (kg)"),
        ("3 stone", ("object", "mass"), "give the number without 'stone': units are SI (kg)"),
        ("1,000", ("object", "mass"), "write 1000 or 1, without the comma"),
        ("2,500 g", ("object", "mass"), "write 2500 g or 2.5 g, without the comma"),
        ("0,125", ("object", "mass"), "write 0.125"),
        ("2,5", ("object", "mass"), "write 2.5"),
        ("heavy", ("object", "mass"), ""),
        ("1e300", ("object", "mass"), ""),
        ("-0.5", ("object", "mass"), ""),
        ("1 2 3", ("object", "mass"), ""),
    ],
)
def test_what_to_write_instead(found, location, advice):
    said = si_advice(found, location)
    assert said.startswith(f"; {advice}") if advice else said == ""
