from statistics import NormalDist

import numpy as np
import pytest

from hpcpic.core.space.rng import normal_quantile, normals, uniforms
from hpcpic.core.space.rng_kernels import philox


@pytest.mark.parametrize(
    "counter, key, answer",
    [
        ("0 0 0 0", "0 0", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff " * 4, "ffffffff " * 2, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        (
            "243f6a88 85a308d3 13198a2e 03707344",
            "a4093822 299f31d0",
            "d16cfe09 94fdcceb 5001e420 24126ea1",
        ),
    ],
)
def test_philox_gives_the_published_answers(counter, key, answer):
    counter, key, answer = ([np.uint64(int(w, 16)) for w in text.split()] for text in (counter, key, answer))
    assert list(philox(*counter, *key)) == answer


def test_known_numbers_stay():
    """The initial states of all runs hang on them; from a version in plain numpy."""
    known = [
        ["0x1.4e87fa30b7458p-4", "0x1.d3f2c0a47738ap-2", "0x1.f17e8209f91cep-2"],
        ["0x1.579fbbdd5432dp-1", "0x1.8be321d3ce9a6p-2", "0x1.f631f2a89ea99p-1"],
        ["0x1.c9331442a44bbp-1", "0x1.ec5411093a5ddp-1", "0x1.6abbc3c276451p-1"],
    ]
    assert [[x.hex() for x in row] for row in uniforms(3, 1, [0, 1, 2**40], 3)] == known
    known = [["-0x1.b87b51febe7bap-7", "-0x1.7e5e156121ebbp-2"], ["0x1.13e900e2a787fp+1", "-0x1.b6b57c7cfaa63p+0"]]
    assert [[x.hex() for x in row] for row in normals(3, 2, [0, 3], 2)] == known  # of the centre, of the tails


@pytest.mark.parametrize("draw", [uniforms, normals])
def test_bits_belong_to_the_id(draw):
    ids = np.arange(40_000)  # more than one chunk
    whole = draw(7, 2, ids, 5)
    order = np.random.default_rng(0).permutation(ids)
    assert np.array_equal(draw(7, 2, order, 5), whole[order])
    for part in (ids[3:4], ids[17_001:17_020], ids[:0]):
        for n in (1, 2, 5):
            assert np.array_equal(draw(7, 2, part, n), whole[part, :n])


def test_seeds_streams_and_large_ids_give_other_numbers():
    ids = np.array([0, 1, 1 << 32, (1 << 62) + 1])
    draws = [uniforms(seed, stream, ids, 3) for seed in (0, 1, 1 << 40) for stream in (0, 1)]
    assert len(np.unique(np.concatenate(draws))) == 6 * 4 * 3
    with pytest.raises(ValueError, match="seed"):
        uniforms(-1, 0, ids, 1)


def test_uniforms_have_the_moments_of_a_uniform_distribution():
    u = uniforms(1, 0, np.arange(200_000), 2)
    n = u.size
    assert u.min() > 0 and u.max() < 1
    for k in (1, 2, 3, 4):  # five standard errors of the moment
        assert abs((u**k).mean() - 1 / (k + 1)) < 5 * np.std(u**k) / np.sqrt(n)
    assert abs(np.corrcoef(u.T)[0, 1]) < 5 / np.sqrt(len(u))
    assert abs(np.corrcoef(u[:-1, 0], u[1:, 0])[0, 1]) < 5 / np.sqrt(len(u))


def test_normals_have_the_moments_of_a_normal_distribution():
    z = normals(1, 0, np.arange(200_000), 2).ravel()
    for k, moment in ((1, 0), (2, 1), (3, 0), (4, 3)):
        assert abs((z**k).mean() - moment) < 5 * np.std(z**k) / np.sqrt(z.size)


def test_quantile_is_that_of_the_standard_library_and_odd():
    u = np.concatenate([np.linspace(0.001, 0.999, 999), 2.0 ** -np.arange(2, 53)])
    expected = [NormalDist().inv_cdf(p) for p in u]
    np.testing.assert_allclose(normal_quantile(u), expected, rtol=4e-16, atol=1e-300)
    dyadic = np.arange(1, 64) / 64
    np.testing.assert_array_equal(normal_quantile(1 - dyadic), -normal_quantile(dyadic))
