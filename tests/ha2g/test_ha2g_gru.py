"""The compiled GRU against torch's own: states, gradients, dropout, and what it refuses."""

import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from cospeech.gestures.ha2g.networks.gru import GRU, dropout
from cospeech.learning.recurrence import tanh


def of_torch(gru, x):
    """The sum of the directions that `torch.nn.GRU` makes with the same weights."""
    plain = torch.nn.GRU(
        gru.input_size, gru.hidden_size, gru.num_layers, batch_first=True, bidirectional=gru.bidirectional
    )
    plain.load_state_dict(gru.state_dict())
    y = plain(x)[0]
    return plain, sum(y.split(gru.hidden_size, dim=2))


@settings(max_examples=40, deadline=None)
@given(
    windows=st.integers(1, 14),
    frames=st.integers(1, 9),
    channels=st.integers(1, 20),
    hidden=st.integers(1, 150),
    layers=st.integers(1, 3),
    both=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_states_and_gradients_are_those_of_torch(windows, frames, channels, hidden, layers, both, seed):
    torch.manual_seed(seed)
    gru, x = GRU(channels, hidden, layers, 0.0, both), 3 * torch.randn(windows, frames, channels)
    weights, ours, theirs = torch.randn(windows, frames, hidden), x.clone().requires_grad_(), x.requires_grad_()
    made = gru(ours)
    plain, expected = of_torch(gru, theirs)
    torch.testing.assert_close(made, expected, rtol=0, atol=3e-6)
    (made * weights).sum().backward()
    (expected * weights).sum().backward()
    of_plain = dict(plain.named_parameters())
    for name, ours_at, theirs_at in [("x", ours.grad, theirs.grad)] + [
        (name, parameter.grad, of_plain[name].grad) for name, parameter in gru.named_parameters()
    ]:
        scale = theirs_at.abs().max().item() + 0.1  # a small gradient is a sum of numbers around 1, each rounded
        assert (ours_at - theirs_at).abs().max().item() < 3e-5 * scale, name


def test_tanh_and_its_ends():
    numbers = np.append(np.linspace(-12, 12, 100_001), [-np.inf, np.inf]).astype(np.float32)
    made = njit(lambda x: np.array([tanh(number) for number in x]))(numbers)
    assert np.abs(made - np.tanh(numbers.astype(np.float64))).max() < 2e-7
    assert np.abs(made).max() <= 1


@pytest.mark.parametrize("twice", [False, True])
def test_what_is_no_number_stays_none(twice):
    """So that a training that diverges is stopped, whichever way its GRUs run."""
    gru, x = GRU(3, 5, 2, 0.0, twice=twice), torch.randn(2, 7, 3)
    x[1, 6, 2] = torch.nan
    made = gru(x)
    assert made[1].isnan().all() and not made[0].isnan().any()


def test_differentiated_twice_only_where_asked_for():
    x, head = torch.randn(2, 7, 3, requires_grad=True), torch.nn.Linear(5, 1)
    (gradient,) = torch.autograd.grad(head(GRU(3, 5, 1, 0.0, twice=True)(x)).sum(), x, create_graph=True)
    gradient.square().sum().backward()
    assert x.grad.abs().max() > 0
    (gradient,) = torch.autograd.grad(head(GRU(3, 5, 1, 0.0)(x)).sum(), x, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.square().sum().backward()
    made = GRU(3, 5, 1, 0.0)(x).sum()
    made.backward(retain_graph=True)
    with pytest.raises(RuntimeError, match="taken back before"):
        made.backward()


def test_dropout_between_layers_alone_and_in_training():
    torch.manual_seed(0)
    gru, x = GRU(3, 8, 2, 0.5), torch.randn(4, 9, 3)
    torch.testing.assert_close(gru.eval()(x), of_torch(gru, x)[1], rtol=0, atol=3e-6)
    assert (gru.train()(x) - gru(x)).abs().max() > 1e-3
    single = GRU(3, 8, 1, 0.5)
    assert torch.equal(single(x), single(x))


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_dropout_is_as_large_as_asked_for_and_anew_everywhere(share):
    torch.manual_seed(1)
    x = torch.ones(999, 1001)
    y = dropout(x, share)
    assert set(y.unique().tolist()) == {0.0, torch.tensor(1 / (1 - share)).item()}
    zeros = (y == 0).double()
    noise = (share * (1 - share)) ** 0.5
    assert abs(zeros.mean() - share) < 5 * noise / 1000 + 1 / 65536
    # Neighbours, of which four come from one random number, do not go together.
    for apart in (1, 2, 3, 4):
        together = ((zeros[:, apart:] - share) * (zeros[:, :-apart] - share)).mean() / noise**2
        assert abs(together) < 0.005
    torch.manual_seed(1)
    assert torch.equal(dropout(x, share), y)
    assert dropout(x, 0.0) is x


BYTES = """
import hashlib, torch
from cospeech.gestures.ha2g.networks.gru import GRU
torch.manual_seed(0)
gru, x = GRU(40, 76, 2, 0.1), torch.randn(32, 34, 40)
gru(x).square().sum().backward()
print(hashlib.sha256(b"".join(p.grad.numpy().tobytes() for p in gru.parameters())).hexdigest())
"""


def test_compiled_now_or_found_in_the_cache_same_bytes(tmp_path):
    """Numba links both otherwise, which shows as soon as a kernel may reorder its arithmetic."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def run():
        command = [sys.executable, "-c", BYTES]
        return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout

    first = run()
    assert list(tmp_path.rglob("*.nbc")) and run() == first


def test_gru_sums_its_directions():
    torch.manual_seed(0)
    gru, x = GRU(3, 5, 1, 0.0), torch.randn(2, 7, 3)
    weights = dict(gru.named_parameters())
    both = []
    for suffix, heard in (("", x), ("_reverse", x.flip(1))):
        one = torch.nn.GRU(3, 5, batch_first=True)
        one.load_state_dict({name: weights[name + suffix] for name in one.state_dict()})
        both.append(one(heard)[0])
    torch.testing.assert_close(gru(x), both[0] + both[1].flip(1))
