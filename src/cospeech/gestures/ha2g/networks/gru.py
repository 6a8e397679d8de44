"""The GRU of HA2G and of the networks beside it, for training on any device, and for ONNX."""

import torch
from torch import nn

from cospeech.learning.recurrence import Recurrence


class GRU(nn.GRU):
    """A GRU, batch first, whose directions are summed if it has two: (N, T, C) -> (N, T, hidden).

    On the processor its frames run compiled (`recurrence`); twice: whether it shall be differentiated twice, as a
    penalty on gradients does, which only torch's own can.
    """

    def __init__(self, channels, hidden, layers, dropout, bidirectional=True, twice=False):
        dropout = dropout if layers > 1 else 0.0
        super().__init__(channels, hidden, layers, batch_first=True, dropout=dropout, bidirectional=bidirectional)
        self.twice = twice

    def forward(self, x):
        if torch.compiler.is_exporting():
            return self._as_onnx(x)
        if self.twice or x.device.type != "cpu" or x.dtype != torch.float32:
            return sum(super().forward(x)[0].split(self.hidden_size, dim=2))
        return self._compiled(x)

    def _layer(self, layer):
        """W_i, W_h, b_i and b_h of a layer, each a list of its directions'."""
        ends = [f"l{layer}{direction}" for direction in ("", "_reverse")[: 1 + self.bidirectional]]
        for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"):
            yield [getattr(self, f"{name}_{end}") for end in ends]

    def _compiled(self, x):
        x = x.transpose(0, 1).contiguous()
        for layer in range(self.num_layers):
            inputs, states, *biases = self._layer(layer)
            if layer and self.training:
                x = dropout(x, self.dropout)
            biases = (torch.stack(bias).unflatten(1, (3, -1)) for bias in biases)
            y = Recurrence.apply(x, torch.cat(inputs), torch.stack(states), *biases)
            x = y.flatten(2)  # the directions side by side
        return y.sum(2).transpose(0, 1)

    def _as_onnx(self, x):
        """The same in ONNX's own operator; torch's exporter would unroll every frame, which takes it minutes."""
        x = x.transpose(0, 1)
        attributes = {
            "hidden_size": self.hidden_size,
            "linear_before_reset": 1,
            "direction": "bidirectional" if self.bidirectional else "forward",
        }
        for layer in range(self.num_layers):
            inputs, states, biases_in, biases = (
                torch.stack([self._in_onnx_order(weights) for weights in directions])
                for directions in self._layer(layer)
            )
            shape = (x.shape[0], len(inputs), x.shape[1], self.hidden_size)
            given = (x, inputs, states, torch.cat([biases_in, biases], dim=1))
            y = torch.onnx.ops.symbolic("GRU", given, attributes, dtype=x.dtype, shape=shape)
            x = y.transpose(1, 2).flatten(2)
        return y.sum(1).transpose(0, 1)

    def _in_onnx_order(self, weights):
        """Torch's reset, update, new as update, reset, new."""
        size = self.hidden_size
        return torch.cat([weights[size : 2 * size], weights[:size], weights[2 * size :]])


def dropout(x, share):
    """Zeros in place of a share of x, known to 1/65536, and the rest larger for it.

    `torch.dropout` draws a random number for each of x, which is slow on the processor; here each number serves four.
    """
    if not share:
        return x
    drawn = torch.empty(-(-x.numel() // 4), dtype=torch.int64).random_(-(2**63), None)
    kept = drawn.view(torch.int16)[: x.numel()].view_as(x) >= round(share * 65536) - 32768
    return x * (kept.to(x.dtype) / (1 - share))
