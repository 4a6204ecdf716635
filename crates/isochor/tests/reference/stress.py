"""The least stress that SciPy's L-BFGS-B finds: stress.py FILE

FILE has a line "x y" for each point of the start, then a line "i j d" for each pair, both ways.
"""

import sys

import numpy
from scipy.optimize import minimize

rows = [line.split() for line in open(sys.argv[1])]
start = numpy.array([row for row in rows if len(row) == 2], float)
pairs = numpy.array([row for row in rows if len(row) == 3], float)
i, j, d = pairs[:, 0].astype(int), pairs[:, 1].astype(int), pairs[:, 2]


def stress(x):
    x = x.reshape(-1, 2)
    apart = x[i] - x[j]
    length = numpy.hypot(apart[:, 0], apart[:, 1])
    off = length - d
    gradient = numpy.zeros_like(x)
    pull = (2 * off / length)[:, None] * apart
    numpy.add.at(gradient, i, pull)
    numpy.add.at(gradient, j, -pull)
    return (off**2).sum(), gradient.ravel()


limits = {"maxiter": 100_000, "maxfun": 1_000_000, "ftol": 0, "gtol": 1e-11, "maxcor": 30}
print(repr(float(minimize(stress, start.ravel(), jac=True, method="L-BFGS-B", options=limits).fun)))
