"""Random bits as pure functions of a key and a counter, with the same bits on every machine.

These functions are what `Stream` and compiled kernels share. They are scalar, hold 32-bit words in
64-bit integers, and use of floating point only the five operations whose result IEEE 754 fixes to
the last bit (+ - * / sqrt), never a log or a cosine, which every C library rounds in its own way.
So CPython, a compiler and a GPU agree, provided that the compiler neither reassociates nor
contracts `a * b + c` into one operation (Numba: no `fastmath`; CUDA: `fma=False`).
"""

from math import frexp, sqrt
from typing import Final

WORD: Final = 0xFFFFFFFF  # mask of a 32-bit word
SPAN: Final = 0x100000000  # how many 32-bit words there are
STEPS: Final = 9007199254740992  # 2 ** 53: how many evenly spaced doubles there are in [0, 1)
STEP: Final = 1.0 / STEPS

# Multipliers, and what the key's words grow by in each round (golden ratio, sqrt(3) - 1).
# Source: Salmon et al. 2011, section 4.3.
M0: Final = 0xD2511F53
M1: Final = 0xCD9E8D57
W0: Final = 0x9E3779B9
W1: Final = 0xBB67AE85

# Coefficients of PPND16, the highest power first: in the middle, in the tails, far out.
# Source: Wichura 1988, "Algorithm AS 241: The percentage points of the normal distribution".
_Poly = tuple[float, float, float, float, float, float, float, float]
_MID_TOP: Final[_Poly] = (
    2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4,
    4.5921953931549871457e4, 1.3731693765509461125e4, 1.9715909503065514427e3,
    1.3314166789178437745e2, 3.3871328727963666080e0,
)  # fmt: skip
_MID_LOW: Final[_Poly] = (
    5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4,
    2.1213794301586595867e4, 5.3941960214247511077e3, 6.8718700749205790830e2,
    4.2313330701600911252e1, 1.0,
)  # fmt: skip
_TAIL_TOP: Final[_Poly] = (
    7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1,
    1.27045825245236838258e0, 3.64784832476320460504e0, 5.76949722146069140550e0,
    4.63033784615654529590e0, 1.42343711074968357734e0,
)  # fmt: skip
_TAIL_LOW: Final[_Poly] = (
    1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2,
    1.48103976427480074590e-1, 6.89767334985100004550e-1, 1.67638483018380384940e0,
    2.05319162663775882187e0, 1.0,
)  # fmt: skip
_FAR_TOP: Final[_Poly] = (
    2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3,
    2.65321895265761230930e-2, 2.96560571828504891230e-1, 1.78482653991729133580e0,
    5.46378491116411436990e0, 6.65790464350110377720e0,
)  # fmt: skip
_FAR_LOW: Final[_Poly] = (
    2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5,
    7.86869131145613259100e-4, 1.48753612908506148525e-2, 1.36929880922735805310e-1,
    5.99832206555887937690e-1, 1.0,
)  # fmt: skip

_LN2: Final = 0.6931471805599453
_SQRT_HALF: Final = 0.7071067811865476
# 1/21, 1/19, ..., 1/3, 1: eleven terms leave less than 2**-58 where |(m - 1) / (m + 1)| < 0.1716.
_ATANH: Final = tuple(1.0 / nonconforming for nonconforming in range(21, 0, -2))


def philox4x32(c0: int, c1: int, c2: int, c3: int, k0: int, k1: int) -> tuple[int, int, int, int]:
    """Four 32-bit words are the ten-round Philox image of the counter c0..c3 under the key k0, k1.

    Signed 64-bit integers that wrap give the same words as Python's: each product is masked before
    it is used.

    Source: Salmon, Moraes, Dror, Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3".
    """
    for _ in range(10):
        p0 = M0 * c0
        p1 = M1 * c2
        c0, c1, c2, c3 = (
            ((p1 >> 32) & WORD) ^ c1 ^ k0,
            p1 & WORD,
            ((p0 >> 32) & WORD) ^ c3 ^ k1,
            p0 & WORD,
        )
        k0 = (k0 + W0) & WORD
        k1 = (k1 + W1) & WORD
    return c0, c1, c2, c3


def unit_of(first: int, second: int) -> float:
    """Two words are one of the 2**53 evenly spaced doubles in [0, 1), all equally likely."""
    return ((first >> 5) * 67108864 + (second >> 6)) * STEP


def normal_of(first: int, second: int) -> float:
    """Two words are one standard normal number: the quantile of their 52-bit uniform number.

    Always two words and no rejection, monotone and exactly antisymmetric in them, so that two
    streams that are in step stay in step. Correct to a few units in the last place; the largest
    magnitude is 8.21.

    Source: Wichura 1988, AS 241 (PPND16).
    """
    nonconforming = 2 * (first * 1048576 + (second >> 12)) + 1  # out of 2**53: never 0, 1 or a half
    q = nonconforming * STEP - 0.5
    if -0.425 <= q <= 0.425:
        return q * _ratio(0.180625 - q * q, _MID_TOP, _MID_LOW)
    r = sqrt(-log_of(min(nonconforming, STEPS - nonconforming) * STEP))
    x = _ratio(r - 1.6, _TAIL_TOP, _TAIL_LOW) if r <= 5.0 else _ratio(r - 5.0, _FAR_TOP, _FAR_LOW)
    return -x if q < 0.0 else x


def log_of(x: float) -> float:
    """The natural logarithm of a positive, finite double, made of the five fixed operations.

    Source: Abramowitz & Stegun 4.1.27, ln m = 2 atanh((m - 1) / (m + 1)), m in [0.707, 1.415).
    """
    m, exponent = frexp(x)
    if m < _SQRT_HALF:
        m *= 2.0
        exponent -= 1
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = 0.0
    for term in _ATANH:
        total = total * z + term
    return exponent * _LN2 + 2.0 * s * total


def _ratio(r: float, top: _Poly, low: _Poly) -> float:
    """The quotient of two polynomials at r, by Horner's rule; written out, in half the time."""
    a, b, c, d, e, f, g, h = top
    above = ((((((a * r + b) * r + c) * r + d) * r + e) * r + f) * r + g) * r + h
    a, b, c, d, e, f, g, h = low
    below = ((((((a * r + b) * r + c) * r + d) * r + e) * r + f) * r + g) * r + h
    return above / below
