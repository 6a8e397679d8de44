"""The losses of HA2G and Trimodal, unweighted, each a scalar. Poses are (N, T, C), scores (N,)."""

import torch
from torch.nn import functional as F

EPSILON = 1e-8  # inside the logarithms of probabilities
NEAR = 1e-5  # of 1: cosines this close have no usable angle gradient
VARIANCE = 1e-4  # least variance of an angle in units of pi squared (1.8 degrees): rigid bones have none of their own


def huber(levels, targets, beta=0.1):
    """Eq. 5: the mean smooth L1 distance of each level, summed over levels. Lists of (N, T, D)."""
    return sum(
        F.smooth_l1_loss(predicted, target, beta=beta) for predicted, target in zip(levels, targets, strict=True)
    )


def discriminator_loss(real, generated):
    """What the discriminator lowers (eq. 6): -log D(real) - log(1 - D(generated)), D the sigmoid of scores (N,)."""
    return -(torch.log(real.sigmoid() + EPSILON) + torch.log(1 - generated.sigmoid() + EPSILON)).mean()


def generator_loss(generated):
    """What the generator lowers (eq. 6): the non-saturating -log D(generated)."""
    return -torch.log(generated.sigmoid() + EPSILON).mean()


def least_squares_discriminator_loss(real, generated):
    """The discriminator's loss of a least-squares GAN (Mao et al. 2017): real scores to 1, generated ones to 0."""
    return (real - 1).square().mean() + generated.square().mean()


def least_squares_generator_loss(generated):
    """The generator's loss of a least-squares GAN: its scores to 1."""
    return (generated - 1).square().mean()


def divergence(mean, log_variance):
    """Kullback-Leibler divergence of the style vectors from a normal distribution, mean over elements."""
    return -0.5 * (1 + log_variance - mean.square() - log_variance.exp()).mean()


def diverging(poses, others, style, other_style, beta=0.05, clamp=1000.0):
    """Eq. 7: minus the distance of the poses per distance of the styles that made them, at least -`clamp`.

    The other branch and both styles are constants: only what the style does to `poses` is taught.
    """
    apart = F.smooth_l1_loss(poses, others.detach(), beta=beta, reduction="none").sum((1, 2))
    styles = (style - other_style).detach().abs().mean(1)
    return torch.clamp(-apart / (styles + 1e-5), min=-clamp).mean()


def included_angles(vectors, table):
    """`levels.included_angles` for training: (N, T, V, 3) of any length -> (N, T, P) in units of pi."""
    vectors = F.normalize(vectors, dim=-1)
    of = lambda numbers: vectors[..., torch.as_tensor(numbers, device=vectors.device), :]
    first, second = of(table.angle_pairs[:, 0]), of(table.angle_pairs[:, 1])
    normals = torch.cross(of(table.palm_pairs[:, 1]), of(table.palm_pairs[:, 2]), dim=-1)
    first = torch.cat([first, of(table.palm_pairs[:, 0])], dim=-2)
    second = torch.cat([second, F.normalize(normals, dim=-1)], dim=-2)
    return torch.acos((first * second).sum(-1).clamp(NEAR - 1, 1 - NEAR)) / torch.pi


def physical(angles, mean, variance):
    """Eq. 8, again printed as eq. 12: minus the log-likelihood of angles (N, T, P) under a Gaussian each, no constant.

    Means over windows and frames, summed over the pairs.
    """
    return ((angles - mean).square() / (2 * variance.clamp_min(VARIANCE))).mean((0, 1)).sum()


def contrastive(text, features, temperature, in_level=True, cross_level=True):
    """Eq. 2: the words of a frame shall be nearest to that frame's high-level audio.

    Parameters
    ----------
    text : (S, C), a sample per frame. features : low, mid, high, (3, S, C).
    temperature : of the cosine similarities.
    in_level : negatives are the high-level features of other frames and clips.
    cross_level : negatives are all low and mid features.
    """
    low, mid, high = F.normalize(features, dim=-1) / temperature
    text = F.normalize(text, dim=-1)
    matching = (text * high).sum(1, keepdim=True)
    candidates = [text @ high.T if in_level else matching]
    if cross_level:
        candidates += [text @ low.T, text @ mid.T]
    return (torch.logsumexp(torch.cat(candidates, dim=1), dim=1) - matching[:, 0]).mean()


def contrastive_by_distance(text, features):
    """The released code's form: logits are inverse distances, without a temperature; low is pushed away.

    The weights between the two terms are its own: 0.2 for high, -0.005 for low; mid is left out. Returns the sum
    divided by 0.2, so that one weight serves both forms.
    """
    own = torch.arange(len(text), device=text.device)
    low, _, high = (F.cross_entropy(1 / (torch.cdist(text, level) + EPSILON), own) for level in features)
    return high - 0.005 / 0.2 * low
