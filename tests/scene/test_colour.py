"""The colour network."""

import torch
from torch.nn.functional import normalize

from pacnerf_lpo.scene.colour import ColourNetwork, encode_directions


def test_size_of_the_network():
    count = sum(parameter.numel() for parameter in ColourNetwork().parameters())
    assert count == (39 * 128 + 128) + (128 * 128 + 128) + (128 * 3 + 3)


def test_encoding_has_the_sines_and_cosines_of_four_octaves():
    encoded = encode_directions(torch.tensor([[0.6, 0.0, -0.8]]))
    assert encoded.shape == (1, 27)
    expected = torch.tensor([[0.6 * 2.0**k for k in range(4)]])
    torch.testing.assert_close(encoded[:, 3:7], expected.sin())
    torch.testing.assert_close(encoded[:, 15:19], expected.cos())


def test_split_first_layer_equals_the_whole_one():
    torch.manual_seed(0)
    network, features = ColourNetwork().double(), torch.randn(7, 12, dtype=torch.float64)
    directions = normalize(torch.randn(7, 3, dtype=torch.float64), dim=1)
    hidden = network.first(torch.cat((features, encode_directions(directions)), dim=1)).relu()
    expected = network.last(network.second(hidden).relu()).sigmoid()
    torch.testing.assert_close(network(features, directions), expected, rtol=0, atol=1e-14)
