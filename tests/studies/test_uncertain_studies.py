"""Studies of scenes that say what is not known exactly of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from study_tools import CUBOID, Here

from graspless_pin import load_scene, read_results, run_study
from graspless_pin.errors import StudyError
from graspless_pin.studies import Study, results_summary

COMPUTE = {"algorithm": "torque", "margin": 0.1, "static_friction": "coulomb"}


def study_of(folder: Path, vary: dict, uncertainty: dict | None = None, **more) -> Study:
    data = yaml.safe_load(CUBOID.read_text(encoding="utf-8"))
    if uncertainty is not None:
        data["uncertainty"] = uncertainty
    (folder / "scene.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    content = {"scene": str(folder / "scene.yaml"), "vary": vary, "compute": COMPUTE, **more}
    return Study.from_data(content)


def test_rows_have_the_torques_for_the_whole_set(tmp_path: Path) -> None:
    shares = {"from": 0.0, "to": 0.3, "steps": 3}
    width = {"key": "uncertainty.center_of_mass", "from": 5, "to": 200, "steps": 2, "unit": "mm"}
    study = study_of(tmp_path, {"uncertainty.mass": shares, "width": width}, {"mass": 0.1})
    output, other = tmp_path / "results.csv", tmp_path / "results.parquet"
    for file in (other, output):
        run_study(study, file, executor=Here(), progress=False)
    table: Any = read_results(output)
    pd.testing.assert_frame_equal(read_results(other), table)
    assert len(table) == 6 and table["found"].all()
    assert str(table["robust_found"].dtype) == "boolean"
    scene = load_scene(tmp_path / "scene.yaml")
    options = {"margin": 0.1, "static_friction": "coulomb"}
    nominal = scene.solve("torque", **options)
    np.testing.assert_allclose(table["max_torque_Nm"], nominal.max_torque, rtol=1e-6)
    for row in table.to_dict("records"):
        stated = {
            "uncertainty.mass": row["uncertainty.mass"],
            "uncertainty.center_of_mass": 1e-3 * row["width_mm"],
        }
        found = scene.with_changes(stated).solve("torque", uncertainty=True, **options)
        assert row["robust_found"] == found.found
        assert row["robust_status"] == found.status.name.lower()
        assert row["robust_coverage"] == "whole_set"
        if found.found:
            assert row["robust_max_torque_Nm"] == pytest.approx(found.max_torque, rel=1e-6)
            assert row["robust_margin_N"] == pytest.approx(found.margin, abs=1e-6)
        else:
            assert np.isnan(row["robust_max_torque_Nm"])
    served = table["robust_found"].sum()
    assert 0 < served < 6
    said = f"torques that serve the whole uncertainty: {served} of 6 found"
    assert said in results_summary(table) and said in results_summary(output)


def test_rows_of_balls_have_the_largest_torques_of_all_members(tmp_path: Path) -> None:
    vary = {"push": {"key": "uncertainty.force_radius", "from": 0.1, "to": 0.4, "steps": 2}}
    study = study_of(tmp_path, vary, {"mass": 0.1})
    output = tmp_path / "results.csv"
    run_study(study, output, executor=Here(), progress=False)
    table: Any = read_results(output)
    scene = load_scene(tmp_path / "scene.yaml")
    for radius, told in zip(table["push_N"], table["robust_max_torque_Nm"], strict=True):
        known = scene.with_changes({"uncertainty.force_radius": radius})
        found = known.solve("torque", uncertainty=True, margin=0.1, static_friction="coulomb")
        assert found.policy is not None
        assert told == pytest.approx(found.max_torque, rel=1e-6)
    assert table["robust_found"].all()


def test_rows_of_sampled_positions_have_the_share_that_is_served(tmp_path: Path) -> None:
    off = {"key": "uncertainty.contact_position", "from": 0, "to": 3, "steps": 2, "unit": "mm"}
    output = tmp_path / "results.csv"
    run_study(
        study_of(tmp_path, {"off": off}, {"mass": 0.1}), output, executor=Here(), progress=False
    )
    table: Any = read_results(output)
    assert table["robust_coverage"].tolist() == ["whole_set", "sampled"]
    scene = load_scene(tmp_path / "scene.yaml").with_changes({"uncertainty.contact_position": 3e-3})
    found = scene.solve("torque", uncertainty=True, margin=0.1, static_friction="coulomb")
    assert found.samples is not None and found.samples.served >= 190
    share = found.samples.served / found.samples.count
    assert np.isnan(table["robust_sampled_share"][0])
    assert table["robust_sampled_share"][1] == pytest.approx(share)


def test_where_a_set_ceases_to_be_served(tmp_path: Path) -> None:
    """A grid that is refined where `robust_found` changes."""
    vary = {"off": {"key": "uncertainty.center_of_mass", "from": 0.0, "to": 0.2, "steps": 3}}
    sampling = {"method": "adaptive", "border": "robust_found", "depth": 3}
    set_of_mass = {"mass": 0.3}
    output = tmp_path / "results.csv"
    run_study(
        study_of(tmp_path, vary, set_of_mass, sampling=sampling),
        output,
        executor=Here(),
        progress=False,
    )
    table: Any = read_results(output)
    served = table.loc[table["robust_found"], "off_m"].max()
    refused = table.loc[~table["robust_found"], "off_m"].min()
    assert served < refused <= served + 0.0126


def test_figures_have_their_units_and_mistakes_their_names(tmp_path: Path) -> None:
    tilt = {"from": 1, "to": 2, "steps": 2, "unit": "deg"}
    study = study_of(tmp_path, {"uncertainty.tilt": tilt}, {"mass": 0.1})
    scenes = [study.scene_at(one) for one in study.samples]
    tilts = [one.uncertainty.tilt for one in scenes if one.uncertainty is not None]
    np.testing.assert_allclose(np.rad2deg(tilts), [1.0, 2.0])
    heavier = {"key": "uncertainty.mass_offset", "from": 5, "to": 20, "steps": 2, "unit": "g"}
    study = study_of(tmp_path, {"heavier": heavier}, {"mass": 0.1})
    scenes = [study.scene_at(one) for one in study.samples]
    offsets = [one.uncertainty.mass_offset for one in scenes if one.uncertainty is not None]
    np.testing.assert_allclose(offsets, [0.005, 0.02])
    with pytest.raises(StudyError, match=r"unit.*'kg'.*; for kg use uncertainty.mass_offset"):
        share = {"from": 0.1, "to": 0.2, "steps": 2, "unit": "kg"}
        study_of(tmp_path, {"uncertainty.mass": share})
    with pytest.raises(StudyError, match="its column 'robust_found' would have"):
        named = {"robust_found": {"key": "uncertainty.mass", "from": 0.1, "to": 0.2, "steps": 2}}
        run_study(study_of(tmp_path, named), tmp_path / "x.csv", executor=Here(), progress=False)
