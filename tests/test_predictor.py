"""Claims about the LSTM predictor: it is torch's LSTM, it learns, and what is shipped beats constant velocity."""

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from dualnav_lite.__main__ import main
from dualnav_lite.config import UnusableInput
from dualnav_lite.forecast import OUTPUTS, SHIPPED, LstmPredictor, describe, forecast, shipped
from dualnav_lite.forecast_errors import errors_of, futures
from dualnav_lite.kernels import forecast as kernel
from dualnav_lite.motion import STEPS
from dualnav_lite.predictor import (
    Network,
    Samples,
    Settings,
    displacement_loss,
    exported,
    fit,
    load,
    mirrored,
    save,
)
from dualnav_lite.recording import load as load_recording
from dualnav_lite.recording import names
from dualnav_lite.tracking import ConstantVelocityPredictor, follow
from dualnav_lite.train_predictor import UNSEEN, load_predictor_training, train_predictor
from tests.test_recording import SAMPLE

REFERENCE = SHIPPED.parent.parent / "stress_tests" / "reference" / "predictor.csv"
PUBLISHED = SHIPPED.parent.parent / "training" / "predictor.yaml"


def a_network(seed=0):
    torch.manual_seed(seed)
    network = Network(12, 10)
    torch.nn.init.normal_(network.last.weight)
    return network.eval()


def made_up(count=200, seed=0):
    """Samples in which a mover will slow down by the share of its corridor that is blocked."""
    rng = np.random.default_rng(seed)
    sequences = rng.normal(0, 0.5, (count, 10, kernel.SEQUENCE)).astype(np.float32)
    contexts = rng.uniform(0, 1, (count, kernel.CONTEXT)).astype(np.float32)
    targets = np.zeros((count, STEPS + 1, 2), np.float32)
    targets[..., 0] = -(1 - contexts[:, 7:8])
    return Samples(sequences, contexts, targets.reshape(count, OUTPUTS))


def test_the_kernel_is_torchs_network():
    network, samples = a_network(), made_up(30)
    with torch.no_grad():
        wanted = network(torch.from_numpy(samples.sequences), torch.from_numpy(samples.contexts)).numpy()
    weights = LstmPredictor(exported(network)).weights
    outputs = np.empty((1, 30, OUTPUTS), np.float32)
    told = samples.sequences[None], samples.contexts[None]
    kernel.run_network_on_movers(*told, np.ones((1, 30), bool), *weights.values(), outputs)
    np.testing.assert_allclose(outputs[0], wanted, atol=2e-6)
    assert np.abs(wanted).max() > 0.5


def test_a_fresh_network_says_nothing():
    samples = made_up(5)
    with torch.no_grad():
        assert not Network(12, 10)(torch.from_numpy(samples.sequences), torch.from_numpy(samples.contexts)).any()


def test_mirroring_twice_changes_nothing():
    samples = made_up(20)
    tensors = [torch.from_numpy(values) for values in vars(samples).values()]
    for once, kept in zip(mirrored(*mirrored(*tensors)), tensors, strict=True):
        torch.testing.assert_close(once, kept)
    assert (mirrored(*tensors)[0] != tensors[0]).any()


def test_the_loss_is_the_mean_distance_between_the_ways():
    outputs, targets = torch.zeros(1, OUTPUTS), torch.zeros(1, STEPS + 1, 2)
    targets[0, :STEPS, 1] = 0.5  # everybody is 0.5 m/s faster to the left than was said: 5 cm more with every step
    targets[0, STEPS, 0] = 0.3
    loss = displacement_loss(outputs, targets.reshape(1, -1), 0.2)
    assert float(loss) == pytest.approx(0.05 * 10.5 + 0.2 * 0.3, abs=0.01)


def test_it_learns_what_the_room_tells_and_the_same_seed_learns_the_same():
    samples, settings = made_up(), Settings(hidden=8, middle=16, updates=100, batch=64, learning_rate=1e-2)
    losses = []
    network = fit(samples, settings, 3, lambda update, loss: losses.append(loss))
    assert losses[-1] < 0.4 * losses[0]
    again = fit(samples, settings, 3)
    for one, other in zip(network.parameters(), again.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0)


def test_a_loss_that_is_no_number_stops_and_names_the_update():
    samples = made_up(20)
    samples.targets[:] = np.nan
    with pytest.raises(FloatingPointError, match="update 0"):
        fit(samples, Settings(updates=3), 0)
    with pytest.raises(UnusableInput, match="nothing to learn from"):
        fit(Samples(*(values[:0] for values in vars(samples).values())), Settings(updates=3), 0)


def test_a_network_that_says_what_a_sample_asks_for_is_right():
    recording = load_recording(SAMPLE, names(SAMPLE)[0])
    samples, truth = Samples.of(recording, every=3), futures(recording, np.arange(len(recording.scans) - STEPS))
    scans, poses = recording.windows([50])
    told = describe(*follow(scans, poses), poses, scans[:, -1])
    assert told.moving.sum() >= 2
    for k in np.flatnonzero(told.moving[0]):
        (rows,) = np.nonzero((samples.sequences == told.sequences[0, k]).all(axis=(1, 2)))
        outputs = np.zeros((*told.moving.shape, OUTPUTS), np.float32)
        outputs[0, k] = samples.targets[rows[0]]
        gaps = np.linalg.norm(truth[50] - forecast(told, outputs).positions[0, k], axis=-1).max(axis=1)
        assert np.nanmin(gaps) < 1e-4


def test_weights_come_back_and_foreign_files_are_one_clear_line(tmp_path):
    network = a_network()
    paths = save(network, {"seed": 4}, tmp_path, "mine")
    back, card = load(paths["pth"])
    assert card == {"seed": 4}
    for one, other in zip(network.parameters(), back.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0)
    with pytest.raises(UnusableInput, match="no such predictor"):
        load(tmp_path / "none.pth")
    (tmp_path / "text.pth").write_text("text", encoding="utf-8")
    torch.save({"network": {}, "size": {"hidden": 3, "middle": 3}, "card": {}}, tmp_path / "other.pth")
    for name in ("text.pth", "other.pth"):
        with pytest.raises(UnusableInput, match=f"{name}: not a predictor"):
            load(tmp_path / name)


def test_both_shipped_files_hold_the_same_weights_and_are_small():
    network, card = load(SHIPPED.with_suffix(".pth"))
    assert card["samples"] > 10_000
    for name, values in exported(network).items():
        np.testing.assert_array_equal(shipped().weights[name], values)
    assert all(SHIPPED.with_suffix(ending).stat().st_size < 8_000_000 for ending in (".pth", ".npz"))


def test_the_shipped_predictor_beats_constant_velocity_on_the_committed_drive():
    recording = load_recording(SAMPLE, names(SAMPLE)[0])
    models = {
        "constant_velocity": ConstantVelocityPredictor(),
        "lstm": LstmPredictor(exported(load(SHIPPED.with_suffix(".pth"))[0])),
    }
    errors = errors_of(models, recording)
    assert len(errors["lstm"]) > 20
    assert errors["lstm"].mean() < errors["constant_velocity"].mean()


def test_the_published_table_holds_unseen_families_with_both_models():
    table = pd.read_csv(REFERENCE)
    assert list(dict.fromkeys(table.family)) == [*UNSEEN, "all"]
    assert list(table.model) == ["constant_velocity", "lstm"] * (len(UNSEEN) + 1)
    assert table.groupby("family").n.nunique().eq(1).all()
    load_predictor_training(PUBLISHED)


def small_training(folder, **changes):
    content = {"kind": "predictor", "title": "small", "arms": ["straight"], "families": {"pushy.yaml": 2}}
    content |= {"fit": {"updates": 4, "batch": 8, "hidden": 4, "middle": 4}} | changes
    (folder / "small.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    people = {"count": {"low": 4, "high": 6}, "speed_m_s": {"low": 0.5, "high": 1.0}}
    scenario = {"id": "pushy", "title": "p", "title_zh": "p", "people": people}
    (folder / "pushy.yaml").write_text(yaml.safe_dump(scenario), encoding="utf-8")
    return folder / "small.yaml"


def test_train_makes_a_predictor_and_does_not_drive_twice(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("DUALNAV_RUNS", str(tmp_path / "runs"))
    config = small_training(tmp_path)
    assert main(["train", "--config", str(config), "--jobs", "1", "--out", str(tmp_path / "a")]) == 0
    assert "samples of movers" in capsys.readouterr().out
    (shard,) = (tmp_path / "runs" / "small-seed0" / "samples").glob("*.npz")
    kept = shard.stat().st_mtime_ns
    train_predictor(config, out=tmp_path / "b", say=lambda line: None)
    assert shard.stat().st_mtime_ns == kept
    for name in ("w_hidden", "w_last"):
        one, other = (LstmPredictor.load(tmp_path / x / "predictor.npz").weights[name] for x in "ab")
        np.testing.assert_array_equal(one, other)
    changed = small_training(tmp_path, every=2)
    with pytest.raises(UnusableInput, match="another run"):
        train_predictor(changed, say=lambda line: None)


def test_families_of_the_judgement_and_wrong_keys_are_refused(tmp_path, capsys):
    config = small_training(tmp_path, families={"pop_up": 2})
    assert main(["train", "--config", str(config)]) == 2
    assert "'pop_up' is kept for the judgement" in capsys.readouterr().err
    config = small_training(tmp_path, epochs=3)
    assert main(["train", "--config", str(config)]) == 2
    assert "unknown key 'epochs'; known keys here: arms, every, families" in capsys.readouterr().err
    assert main(["predictor", "--weights", str(tmp_path / "none.npz")]) == 2
    assert "no such predictor" in capsys.readouterr().err
