"""A layer of a GRU on the processor: all frames in one compiled call, forwards and backwards.

Torch calls many small operations for every frame of every direction. At the widths of a demo budget the calls take as
long as their arithmetic, and a cascade of six GRUs has six times as many of them.

The equations are those of `torch.nn.GRU` (Cho et al. 2014, the reset gate behind its product), of input x and the
state h before: r = s(W_ir x + b_ir + W_hr h + b_hr), z alike, n = tanh(W_in x + b_in + r (W_hn h + b_hn)), and the
state is then (1 - z) n + z h.

No kernel may reorder its arithmetic ("fastmath"): numba links what it has just compiled otherwise than what it finds in
its cache, and the first training on a machine would end in other bytes than the second. Divisions have numpy's error
model, for Python's checks would keep the loops from becoming vectors.
"""

import numpy as np
import torch
from numba import njit
from torch.nn import functional as F

from cospeech.learning.multiply import COLUMNS, ROWS, multiply_tile

ONE, TWO, HALF, FAR = np.float32(1), np.float32(2), np.float32(0.5), np.float32(9)
# Lambert's continued fraction of tanh, seven deep, as a quotient of polynomials of the square.
ABOVE = tuple(np.float32(c) for c in (135135, 17325, 378, 1))
BELOW = tuple(np.float32(c) for c in (135135, 62370, 3150, 28))


@njit(cache=True, error_model="numpy")
def tanh(x):
    """Within 2e-7, in instructions that compilers make vectors of: that of a quarter of x, doubled twice."""
    x = FAR if x > FAR else x
    x = -FAR if x < -FAR else x
    x = x * HALF * HALF
    s = x * x
    t = x * (ABOVE[0] + s * (ABOVE[1] + s * (ABOVE[2] + s * ABOVE[3])))
    t = t / (BELOW[0] + s * (BELOW[1] + s * (BELOW[2] + s * BELOW[3])))
    t = TWO * t / (ONE + t * t)
    return TWO * t / (ONE + t * t)


@njit(cache=True, error_model="numpy")
def _sigmoid(a, g, b):
    """a = s(a + g + b)."""
    for j in range(len(a)):
        a[j] = HALF + HALF * tanh(HALF * (a[j] + g[j] + b[j]))


@njit(cache=True, error_model="numpy")
def _candidate(a, g, b, r, hidden, hidden_bias):
    """n, in place of a, and what the reset gate was multiplied with."""
    for j in range(len(a)):
        hidden[j] = g[j] + hidden_bias[j]
        a[j] = tanh(a[j] + b[j] + r[j] * hidden[j])


@njit(cache=True, error_model="numpy")
def _mix(n, z, h, state):
    """The next state, in place of h and kept."""
    for j in range(len(n)):
        h[j] = n[j] + z[j] * (h[j] - n[j])
        state[j] = h[j]


@njit(cache=True)
def _multiply(rows, panels, products):
    """products[p] = rows @ panels[p], for rows whose number is a multiple of ROWS."""
    for panel in range(len(panels)):
        for first in range(0, len(rows), ROWS):
            multiply_tile(rows, first, panels[panel], products[panel])


@njit(cache=True)
def forwards(gates, weights, biases, hidden_bias, states, hidden):
    """Run T frames of N windows, the second of D directions from the end; all float32.

    gates (T, N, D, 3, H) : W_i x; becomes r, z, n. weights (D, 3P, H, COLUMNS): W_hr, W_hz, W_hn transposed, each in P
    panels of columns. biases (D, 3, H): b_ir + b_hr, b_iz + b_hz, b_in; hidden_bias (D, H): b_hn. Fills
    states (T, N, D, H) and hidden (T, N, D, H), W_hn h + b_hn.
    """
    frames, windows, directions, width = states.shape
    count = weights.shape[1] // 3
    for d in range(directions):
        h = np.zeros((-(-windows // ROWS) * ROWS, width), np.float32)
        products = np.zeros((3 * count, len(h), COLUMNS), np.float32)
        for i in range(frames):
            t = frames - 1 - i if d else i
            if i:
                _multiply(h, weights[d], products)
            for w in range(windows):
                for p in range(count):
                    of = slice(p * COLUMNS, min(width, (p + 1) * COLUMNS))
                    r, z, n = gates[t, w, d, 0, of], gates[t, w, d, 1, of], gates[t, w, d, 2, of]
                    _sigmoid(r, products[p, w], biases[d, 0, of])
                    _sigmoid(z, products[count + p, w], biases[d, 1, of])
                    of_n = products[2 * count + p, w]
                    _candidate(n, of_n, biases[d, 2, of], r, hidden[t, w, d, of], hidden_bias[d, of])
                    _mix(n, z, h[w, of], states[t, w, d, of])


@njit(cache=True, error_model="numpy")
def _gate_gradients(gradient, product, carried, before, r, z, n, hidden):
    """A state's gradient to those of its gates, in their places, and to what passes by them to the state before."""
    for j in range(len(gradient)):
        of_state = gradient[j] + carried[j] + product[j]
        of_n = of_state * (ONE - z[j]) * (ONE - n[j] * n[j])
        of_z = of_state * (before[j] - n[j]) * z[j] * (ONE - z[j])
        of_r = of_n * hidden[j] * r[j] * (ONE - r[j])
        carried[j] = of_state * z[j]
        hidden[j] = of_n * r[j]
        r[j], z[j], n[j] = of_r, of_z, of_n


@njit(cache=True, error_model="numpy")
def _add(gates, hidden, row, biases):
    """Gradients of a frame as a row to multiply, (r, z, hidden), and added to the biases', (r, z, n, hidden)."""
    for j in range(len(hidden)):
        row[0, j], row[1, j], row[2, j] = gates[0, j], gates[1, j], hidden[j]
        biases[0, j] += gates[0, j]
        biases[1, j] += gates[1, j]
        biases[2, j] += gates[2, j]
        biases[3, j] += hidden[j]


@njit(cache=True)
def backwards(gradients, states, gates, hidden, weights, biases):
    """The gradients of states (T, N, D, H) taken back through all frames.

    weights (D, P, 3H, COLUMNS) : W_h in panels of columns. gates and hidden, as `forwards` left them, become the
    gradients of W_i x + b_i and of W_hn h + b_hn; biases (D, 4, H), zeros, the sums of both.
    """
    frames, windows, directions, width = states.shape
    count, nothing = weights.shape[1], np.zeros(width, np.float32)
    for d in range(directions):
        carried = np.zeros((windows, width), np.float32)
        rows = np.zeros((-(-windows // ROWS) * ROWS, 3, width), np.float32)
        products = np.zeros((count, len(rows), COLUMNS), np.float32)
        for i in range(frames):
            t, earlier = (i, i + 1) if d else (frames - 1 - i, frames - 2 - i)
            for w in range(windows):
                before = states[earlier, w, d] if i < frames - 1 else nothing
                for p in range(count):
                    of = slice(p * COLUMNS, min(width, (p + 1) * COLUMNS))
                    r, z, n = gates[t, w, d, 0, of], gates[t, w, d, 1, of], gates[t, w, d, 2, of]
                    given = products[p, w], carried[w, of], before[of], r, z, n, hidden[t, w, d, of]
                    _gate_gradients(gradients[t, w, d, of], *given)
                _add(gates[t, w, d], hidden[t, w, d], rows[w], biases[d])
            if i < frames - 1:
                _multiply(rows.reshape(len(rows), 3 * width), weights[d], products)


def _panels(matrix):
    """(K, J) -> (P, K, COLUMNS): columns by the registerful, the last filled up with zeros."""
    count = -(-matrix.shape[1] // COLUMNS)
    return F.pad(matrix, (0, count * COLUMNS - matrix.shape[1])).unflatten(1, (count, COLUMNS)).transpose(0, 1)


class Recurrence(torch.autograd.Function):
    """x (T, N, C), W_i (D 3H, C), W_h (D, 3H, H), b_i and b_h (D, 3, H) -> states (T, N, D, H), all float32.

    The first direction runs forwards, the second backwards, both from zero. It can be differentiated once.
    """

    @staticmethod
    def forward(ctx, x, of_inputs, of_states, input_bias, state_bias):
        directions, _, width = of_states.shape
        states = x.new_empty(*x.shape[:2], directions, width)
        hidden = torch.empty_like(states)
        gates = (x.flatten(0, 1) @ of_inputs.T).view(*x.shape[:2], directions, 3, width)
        biases = input_bias.clone()
        biases[:, :2] += state_bias[:, :2]
        weights = torch.stack([torch.cat([_panels(gate.T) for gate in one.chunk(3)]) for one in of_states])
        given = gates, weights, biases, state_bias[:, 2].contiguous(), states, hidden
        forwards(*(tensor.numpy() for tensor in given))
        ctx.save_for_backward(x, of_inputs, of_states, states, gates, hidden)
        ctx.spent = False
        return states

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, gradients):
        if ctx.spent:
            raise RuntimeError("a recurrence has been taken back before: its gates made room for their gradients")
        ctx.spent = True
        x, of_inputs, of_states, states, gates, hidden = ctx.saved_tensors
        biases = x.new_zeros(len(of_states), 4, of_states.shape[2])
        weights = torch.stack([_panels(one) for one in of_states])
        given = gradients.contiguous(), states, gates, hidden, weights, biases
        backwards(*(tensor.numpy() for tensor in given))
        rows = gates.view(-1, len(of_inputs))
        back = rows @ of_inputs
        return (
            back.view_as(x),
            rows.T @ x.flatten(0, 1),
            _of_state_weights(states, gates, hidden),
            biases[:, :3],
            biases[:, [0, 1, 3]],
        )


def _of_state_weights(states, gates, hidden):
    """Gradient of W_h (D, 3H, H): those of its products times the states before them, over all frames."""
    of_one = []
    for d in range(states.shape[2]):
        after, before = (slice(None, -1), slice(1, None)) if d else (slice(1, None), slice(None, -1))
        known = states[before, :, d].flatten(0, 1)
        parts = gates[after, :, d, :2].flatten(2).flatten(0, 1), hidden[after, :, d].flatten(0, 1)
        of_one.append(torch.cat([part.T @ known for part in parts]))
    return torch.stack(of_one)
