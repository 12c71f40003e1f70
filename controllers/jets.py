"""Taylor series in time: exact derivatives of any order of curves that are written as formulas.

A jet holds the coefficients a_0 + a_1 h + a_2 h^2 + ... of a function about a time t; its k-th derivative is k! a_k.

Source: Griewank and Walther, Evaluating Derivatives, 2nd edition, chapter 13 (Taylor arithmetic).
"""

from collections.abc import Callable
from math import factorial
from typing import Union

import numpy as np
from numpy.typing import NDArray

from controllers.signals import Array

Operand = Union["Jet", Array, float]


class Jet:
    """A truncated Taylor series at many times: coefficients (order + 1, ...)."""

    __array_ufunc__ = None  # so that array * jet is left to the jet

    def __init__(self, coefficients: Array) -> None:
        self.coefficients = coefficients

    @classmethod
    def variable(cls, value: Array, slope: float | Array, order: int) -> "Jet":
        """The jet of a linear function of time with this value (...) and slope."""
        coefficients = np.zeros((order + 1, *np.shape(value)))
        coefficients[0] = value
        coefficients[1:2] = slope
        return cls(coefficients)

    def _like(self, other: Operand) -> Array:
        if isinstance(other, Jet):
            return other.coefficients
        shape = np.broadcast_shapes(np.shape(other), self.coefficients.shape[1:])
        constant = np.zeros((len(self.coefficients), *shape))
        constant[0] = other
        return constant

    def __add__(self, other: Operand) -> "Jet":
        return Jet(self.coefficients + self._like(other))

    def __sub__(self, other: Operand) -> "Jet":
        return Jet(self.coefficients - self._like(other))

    def __rsub__(self, other: Operand) -> "Jet":
        return Jet(self._like(other) - self.coefficients)

    def __mul__(self, other: Operand) -> "Jet":
        if not isinstance(other, Jet):
            return Jet(self.coefficients * other)
        a, b = self.coefficients, other.coefficients
        return Jet(np.stack([sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(len(a))]))

    def __truediv__(self, other: "Jet") -> "Jet":
        a, b = self.coefficients, other.coefficients
        quotient: list[Array] = []
        for k in range(len(a)):
            quotient.append((a[k] - sum(quotient[i] * b[k - i] for i in range(k))) / b[0])
        return Jet(np.stack(quotient))

    __radd__, __rmul__ = __add__, __mul__

    def where(self, mask: NDArray[np.bool_], other: "Jet") -> "Jet":
        """This jet where the mask (...) is true, the other elsewhere."""
        return Jet(np.where(mask, self.coefficients, other.coefficients))

    def derivatives(self) -> Array:
        """The function and its time derivatives (order + 1, ...)."""
        factorials = np.array([float(factorial(k)) for k in range(len(self.coefficients))])
        return self.coefficients * factorials.reshape(-1, *(1,) * (self.coefficients.ndim - 1))


def sine_cosine(angle: Jet) -> tuple[Jet, Jet]:
    """Sine and cosine of a jet, rad."""
    a = angle.coefficients
    sine, cosine = [np.sin(a[0])], [np.cos(a[0])]
    for k in range(1, len(a)):
        sine.append(sum(i * a[i] * cosine[k - i] for i in range(1, k + 1)) / k)
        cosine.append(-sum(i * a[i] * sine[k - i] for i in range(1, k + 1)) / k)
    return Jet(np.stack(sine)), Jet(np.stack(cosine))


def arctan2(y: Jet, x: Jet) -> Jet:
    """Direction of (x, y), rad in (-pi, pi]; its rate is (x y' - y x') / (x^2 + y^2)."""
    rate = (x * _rate(y) - y * _rate(x)) / (x * x + y * y)
    steps = np.arange(1.0, len(rate.coefficients)).reshape(-1, *(1,) * (rate.coefficients.ndim - 1))
    return Jet(np.concatenate([np.arctan2(y.coefficients[:1], x.coefficients[:1]), rate.coefficients[:-1] / steps]))


def _rate(jet: Jet) -> Jet:
    """Its time derivative; the last coefficient, which is unknown, is 0."""
    a = jet.coefficients
    steps = np.arange(1.0, len(a)).reshape(-1, *(1,) * (a.ndim - 1))
    return Jet(np.concatenate([a[1:] * steps, np.zeros_like(a[:1])]))


def flat_derivatives(x: Jet, y: Operand, z: Operand, yaw: Operand) -> Array:
    """Flat outputs and their derivatives (order + 1, n, 4) from jets (n,); x decides on the order."""
    columns = [column if isinstance(column, Jet) else 0.0 * x + column for column in (x, y, z, yaw)]
    return np.stack([column.derivatives() for column in columns], axis=-1)


def at_pace(curve: Callable[[Array, int], Array], clock: Jet) -> Array:
    """Derivatives by time (order + 1, n, 4) of a curve that is flown at the pace of a clock.

    Args:
        curve: Takes readings (n,) and the highest derivative; returns derivatives by the reading (order + 1, n, 4).
        clock: (n,) readings.
    """
    order = len(clock.coefficients) - 1
    by_reading = curve(clock.coefficients[0], order)
    change = Jet(clock.coefficients[..., None].copy())
    change.coefficients[0] = 0.0
    total = Jet.variable(by_reading[order] / factorial(order), 0.0, order)
    for k in range(order - 1, -1, -1):
        total = total * change + by_reading[k] / factorial(k)
    return total.derivatives()
