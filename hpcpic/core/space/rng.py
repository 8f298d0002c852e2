"""Random numbers that belong to an id: the same on any rank, in any order, in any number of calls.

Philox4x32-10, a counter-based generator: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as
1, 2, 3", SC11. Key: the 64-bit seed. Counter: id (64 bits), number of the draw (32 bits), stream (32 bits).
The first call of a process compiles, or loads what is compiled (core.space.rng_kernels).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def uniforms(seed: int, stream: int, ids: ArrayLike, n: int) -> NDArray[np.float64]:
    """n numbers in (0, 1) for each id >= 0: float64[len(ids), n]; number k of an id does not depend on n.

    Odd multiples of 2^-53, symmetric about 1/2.
    """
    from hpcpic.core.space import rng_kernels

    if not 0 <= seed < 1 << 64:
        raise ValueError(f"seed {seed} is not in 0 .. 2^64 - 1")
    ids = np.ascontiguousarray(ids, np.int64)
    result = np.empty((len(ids), n))
    key = np.uint64(seed & 0xFFFFFFFF), np.uint64(seed >> 32)
    rng_kernels.uniforms(ids, stream, *key, result)
    return result


def normals(seed: int, stream: int, ids: ArrayLike, n: int) -> NDArray[np.float64]:
    """n numbers of mean 0 and variance 1 for each id, by the quantile function: float64[len(ids), n]."""
    return normal_quantile(uniforms(seed, stream, ids, n))


# Coefficients, constant term first: PPND16 of Wichura, "Algorithm AS 241", Appl. Statistics 37 (1988) 477.
_CENTRE = (
    (
        3.3871328727963666080e0,
        1.3314166789178437745e2,
        1.9715909503065514427e3,
        1.3731693765509461125e4,
        4.5921953931549871457e4,
        6.7265770927008700853e4,
        3.3430575583588128105e4,
        2.5090809287301226727e3,
    ),
    (
        1.0,
        4.2313330701600911252e1,
        6.8718700749205790830e2,
        5.3941960214247511077e3,
        2.1213794301586595867e4,
        3.9307895800092710610e4,
        2.8729085735721942674e4,
        5.2264952788528545610e3,
    ),
)
_MIDDLE = (
    (
        1.42343711074968357734e0,
        4.63033784615654529590e0,
        5.76949722146069140550e0,
        3.64784832476320460504e0,
        1.27045825245236838258e0,
        2.41780725177450611770e-1,
        2.27238449892691845833e-2,
        7.74545014278341407640e-4,
    ),
    (
        1.0,
        2.05319162663775882187e0,
        1.67638483018380384940e0,
        6.89767334985100004550e-1,
        1.48103976427480074590e-1,
        1.51986665636164571966e-2,
        5.47593808499534494600e-4,
        1.05075007164441684324e-9,
    ),
)
_TAIL = (
    (
        6.65790464350110377720e0,
        5.46378491116411436990e0,
        1.78482653991729133580e0,
        2.96560571828504891230e-1,
        2.65321895265761230930e-2,
        1.24266094738807843860e-3,
        2.71155556874348757815e-5,
        2.01033439929228813265e-7,
    ),
    (
        1.0,
        5.99832206555887937690e-1,
        1.36929880922735805310e-1,
        1.48753612908506148525e-2,
        7.86869131145613259100e-4,
        1.84631831751005468180e-5,
        1.42151175831644588870e-7,
        2.04426310338993978564e-15,
    ),
)


def normal_quantile(u: ArrayLike) -> NDArray[np.float64]:
    """x where the standard normal distribution function is u, 0 < u < 1, to about 1e-16 relative."""
    from hpcpic.core.space import rng_kernels

    u = np.ascontiguousarray(u, np.float64)
    x = np.empty_like(u)
    rng_kernels.central(u.reshape(-1), x.reshape(-1), *_CENTRE)
    rng_kernels.tails(u.reshape(-1), x.reshape(-1), *_MIDDLE, *_TAIL)
    return x
