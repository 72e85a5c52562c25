import pandas as pd
import pytest
import yaml

from dualnav_lite.config import UnusableInput
from dualnav_lite.embedded import EmbeddedPolicy
from dualnav_lite.judge import csv_text
from dualnav_lite.studies import load_study, run_study
from dualnav_lite.study_tables import COLUMNS, FOLDER

TINY = {
    "title": "tiny",
    "question": "Does it run?",
    "training": {
        "title": "tiny",
        "worlds": 2,
        "config": {"preference": 0.5},
        "stages": [
            {
                "name": "ppo",
                "kind": "ppo",
                "scenarios": ["navigation"],
                "steps": 16,
                "rollout_steps": 8,
                "ppo": {"minibatch": 8, "micro_batch": 8, "epochs": 1},
            }
        ],
    },
    "variants": {"with": {}, "without": {"config": {"observation.intensity": False}, "ppo": {"epochs": 2}}},
    "seeds": [3],
    "judge": {"scenarios": ["pop_up"], "episodes": 2},
}


def written(folder, changes=None):
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(TINY | (changes or {})), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_studies_can_be_read_and_change_something(path):
    study = load_study(path.stem)
    trainings = [
        (study.variants[variant].learner, study.training_of(variant, 1).model_dump_json(exclude={"title"}))
        for variant in study.variants
    ]
    assert len(set(trainings)) == len(trainings) >= 2


def test_a_variant_changes_what_it_names_and_nothing_else(tmp_path):
    study = load_study(written(tmp_path))
    plain, changed = (study.training_of(variant, 3) for variant in study.variants)
    assert changed.config == {"preference": 0.5, "observation.intensity": False}
    assert (plain.stages[0].ppo.epochs, changed.stages[0].ppo.epochs) == (1, 2)
    assert plain.stages[0].scenarios == changed.stages[0].scenarios
    assert plain.seed == changed.seed == 3


def test_a_study_trains_and_judges_every_variant_and_goes_on_where_it_was(tmp_path, monkeypatch):
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path / "runs"))
    name = written(tmp_path)
    rows = run_study(name, tmp_path / "out")
    assert list(rows.columns) == COLUMNS
    assert rows.variant.tolist() == ["with", "without"]
    assert (rows.episodes == 2).all()
    assert (rows.train_steps == 16).all()
    path = tmp_path / "out" / "studies.csv"
    before = path.read_bytes()
    other = rows.assign(study="another")
    path.write_text(csv_text(pd.concat([rows.assign(survived=-1), other])), encoding="utf-8")
    monkeypatch.setattr("dualnav_lite.ppo.update_policy", None)  # nothing is left to train
    run_study(name, tmp_path / "out")
    assert path.read_text(encoding="utf-8") == csv_text(pd.concat([other, rows]))  # its own rows anew, no other's
    assert before.splitlines() == [line for line in path.read_bytes().splitlines() if not line.startswith(b"another")]


def test_a_study_s_policies_become_arms(tmp_path, monkeypatch):
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path / "runs"))
    monkeypatch.setattr("dualnav_lite.studies.ABLATION_FOLDER", tmp_path / "ablations")
    run_study(written(tmp_path, {"arms": True}), tmp_path / "out")
    made = sorted((tmp_path / "ablations").glob("*.onnx"))
    assert [path.stem for path in made] == ["tiny_with", "tiny_without"]
    assert [EmbeddedPolicy(path).card["observation"]["intensity"] for path in made] == [True, False]


def test_a_flat_observation_and_a_flat_network_go_together(tmp_path, monkeypatch):
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path / "runs"))
    with pytest.raises(UnusableInput, match="go together"):
        load_study(written(tmp_path, {"variants": {"half": {"grain": "flat"}}}))
    flat = {"grain": "flat", "config": {"observation.layout": "flat"}}
    rows = run_study(written(tmp_path, {"variants": {"flat": flat}}), tmp_path / "out")
    assert (rows.episodes == 2).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"judge": {"scenarios": ["pop_up"], "seed_base": 2_000_000}}, "judge.seed_base"),  # test seeds choose nothing
        ({"variants": {"a": {"config": {"map.cash": True}}}}, "unknown key"),
        ({"variants": {"a": {"ppo": {"epoch": 3}}}}, "unknown key"),
        ({"seed": 1}, "unknown key 'seed'"),
    ],
)
def test_a_wrong_study_is_refused_by_name(tmp_path, changes, message):
    with pytest.raises(UnusableInput, match=message):
        load_study(written(tmp_path, changes))
    with pytest.raises(UnusableInput, match=r"unknown study 'nothing'; known: .*stability"):
        load_study("nothing")


def test_the_peer_learns_on_the_same_worlds_and_is_judged_like_ours(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3", reason="needs requirements-bench.txt")
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path / "runs"))
    name = written(tmp_path, {"variants": {"ours": {}, "peer": {"learner": "stable_baselines3"}}})
    rows = run_study(name, tmp_path / "out")
    assert rows.variant.tolist() == ["ours", "peer"]
    assert (rows.episodes == 2).all()
