"""The training loop: interruptions leave no trace in the result, and trouble is named."""

import numpy as np
import pytest
import torch

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.learning import training
from cospeech.learning.training import History, train


class Fit:
    """Fit a line to noisy samples, with dropout so that torch's randomness matters too."""

    def __init__(self, stop_at=None):
        torch.manual_seed(0)
        self.net = torch.nn.Sequential(torch.nn.Linear(1, 16), torch.nn.Dropout(0.2), torch.nn.Linear(16, 1))
        self.modules = {"net": self.net}
        self.optimizers = {"net": torch.optim.Adam(self.net.parameters(), 1e-2)}
        self.stop_at = stop_at

    def iterate(self, step, rng):
        if step == self.stop_at:
            raise KeyboardInterrupt
        x = torch.from_numpy(rng.normal(size=(16, 1)).astype(np.float32))
        loss = ((self.net(x) - 3 * x) ** 2).mean()
        self.optimizers["net"].zero_grad()
        loss.backward()
        self.optimizers["net"].step()
        return {"loss": loss.detach()} | ({"rare": 1.0} if step % 5 == 0 else {})


def weights(task):
    return torch.cat([p.detach().flatten() for p in task.net.parameters()])


def test_resumed_run_equals_an_undisturbed_one(tmp_path, monkeypatch):
    whole = Fit()
    expected = train(whole, 100, seed=4)
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        train(Fit(stop_at=61), 100, seed=4, checkpoint=tmp_path / "c.pt", identity="x")
    resumed = Fit()
    with pytest.warns(CospeechNotice, match="resumed after 61"):
        history = train(resumed, 100, seed=4, checkpoint=tmp_path / "c.pt", identity="x")
    assert torch.equal(weights(whole), weights(resumed))
    assert history.step == expected.step
    np.testing.assert_array_equal(history.losses["rare"], expected.losses["rare"])
    assert history.losses["loss"] == expected.losses["loss"]


@pytest.mark.parametrize("change", [{"identity": "other"}, {"seed": 5}, {"steps": 101}])
def test_checkpoint_of_another_run_is_not_used(tmp_path, monkeypatch, change):
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    run = {"steps": 100, "seed": 4, "identity": "x", "checkpoint": tmp_path / "c.pt"}
    with pytest.raises(KeyboardInterrupt):
        train(Fit(stop_at=61), **run)
    with pytest.warns(CospeechNotice, match="another run"):
        assert train(Fit(), **(run | change)).step[0] == 1


def test_broken_checkpoint_is_not_used(tmp_path):
    (tmp_path / "c.pt").write_bytes(b"half a file")
    with pytest.warns(CospeechNotice, match="unreadable"):
        train(Fit(), 5, checkpoint=tmp_path / "c.pt")


def test_loss_that_is_not_finite_is_named():
    class Diverging(Fit):
        def iterate(self, step, rng):
            return {"body": float("nan") if step == 7 else 1.0}

    with pytest.raises(CospeechError, match="body is not finite after 8"):
        train(Diverging(), 20, label="toy")


def test_history_file(tmp_path):
    history = train(Fit(), 1000, seed=1)
    assert 100 < len(history.step) <= 500 and history.step[-1] == 1000
    assert np.mean(history.losses["loss"][-20:]) < 0.3 * np.mean(history.losses["loss"][:20])
    history.write(tmp_path / "history.h5")
    back = History.read(tmp_path / "history.h5")
    assert back.step == history.step
    np.testing.assert_allclose(back.losses["loss"], history.losses["loss"], rtol=1e-6)
