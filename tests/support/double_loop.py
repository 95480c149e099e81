"""The particle model once more, as a double loop in scalar arithmetic: slow, and written from the text.

Every formula is the one of the method's description (kernels, gradients, pair terms, walls, surfaces, shifting, order
of a step), written independently; of the reference it uses only the parameters of a `Model` and the rows of a `State`.
Numbers are longdoubles, so that it differs from the reference by the reference's rounding.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tests.support.particle_scenes import Scene

L = np.longdouble
PI = 4 * np.arctan(L(1))
Vector = list[Any]


class Neighbour(NamedTuple):
    """One neighbour or image: index, x_i - x_j, distance, W, plain gradient, gradient in use."""

    j: int
    x: Vector
    r: Any
    w: Any
    gw: Vector
    g: Vector


def dot(a: Vector, b: Vector) -> Any:
    return sum((p * q for p, q in zip(a, b, strict=True)), L(0))


def inverse(m: list[Vector]) -> list[Vector]:
    """Inverse of a small matrix by Gauss-Jordan elimination with pivots."""
    n = len(m)
    rows = [[*row, *[L(a == b) for b in range(n)]] for a, row in enumerate(m)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda a: abs(rows[a][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [c / rows[k][k] for c in rows[k]]
        for a in range(n):
            if a != k:
                rows[a] = [p - rows[a][k] * q for p, q in zip(rows[a], rows[k], strict=True)]
    return [row[n:] for row in rows]


class ScalarKernel(NamedTuple):
    """A kernel in longdoubles: cut/h, and of q the shape and its derivative; of dimension and h the normalisation."""

    support: int
    shape: Callable[[Any], Any]
    slope: Callable[[Any], Any]
    sigma: Callable[[int, Any], Any]


QUINTIC = ScalarKernel(
    3,
    lambda q: sum(c * max(k - q, L(0)) ** 5 for k, c in ((3, 1), (2, -6), (1, 15))),
    lambda q: -5 * sum(c * max(k - q, L(0)) ** 4 for k, c in ((3, 1), (2, -6), (1, 15))),
    lambda d, h: L(7) / (478 * PI * h**2) if d == 2 else L(1) / (120 * PI * h**3),
)


class DoubleLoop:
    """A scene, its force evaluation and its time step."""

    def __init__(self, scene: Scene, kernel: ScalarKernel = QUINTIC) -> None:
        self.kernel = kernel
        self.model, self.box = scene.model, scene.box
        s = scene.state
        self.x = [[L(c) for c in row] for row in s.x_nc]
        self.v = [[L(c) for c in row] for row in s.v_nc]
        self.rho = [L(r) for r in s.rho_n]
        self.E = None if s.energy_n is None else [L(e) for e in s.energy_n]
        self.t = [int(t) - 1 for t in s.type_n]
        self.solid = [bool(b) for b in s.solid_n]
        self.n, self.d = len(self.x), self.model.dimension
        self.N, self.D = range(self.n), range(self.d)
        fix = self.model.fix
        self.rc = L(fix.cut)
        self.h = self.rc / kernel.support
        self.sigma = kernel.sigma(self.d, self.h)
        self.m = [L(self.model.mass_t[t]) for t in self.t]
        self.rho0 = [L(fix.rho0[t]) for t in self.t]
        self.c_t = [L(c) for c in fix.cs]
        self.other = [[L(0)] * self.d for _ in self.N]  # the non-pressure accelerations
        self.out: dict[str, Any] = {}

    # kernel

    def W(self, r: Any) -> Any:
        return self.sigma * self.kernel.shape(r / self.h)

    def dW(self, r: Any) -> Any:
        return self.sigma / self.h * self.kernel.slope(r / self.h)

    def neighbours(self, i: int) -> list[Neighbour]:
        found = []
        for j in self.N:
            choices = []
            for a in self.D:
                apart = self.x[i][a] - self.x[j][a]
                if not self.box.periodic[a]:
                    choices.append([apart])
                    continue
                edge = L(self.box.high_c[a]) - L(self.box.low_c[a])
                near = round(float(apart / edge))
                reach = math.ceil(float(self.rc / edge)) + 1
                choices.append([apart - k * edge for k in range(near - reach, near + reach + 1)])
            for x in itertools.product(*choices):
                r = np.sqrt(dot(list(x), list(x)))
                if 0 < r < self.rc:
                    gw = [self.dW(r) * c / r for c in x]
                    found.append(Neighbour(j, list(x), r, self.W(r), gw, gw))
        return found

    # equation of state

    def P(self, i: int, rho: Any) -> Any:
        law = self.model.eos[self.t[i] + 1]
        rho0, c = L(law.rho0), L(law.cs)
        if law.style == "linear":
            p = c**2 * (rho - rho0)
        elif law.style == "cubic":
            p = c**2 * ((rho - rho0) + L(law.parameter) * (rho - rho0) ** 3)
        elif law.style == "ideal/gas":
            p = (L(law.parameter) - 1) * rho * self.E[i] / self.m[i]
        else:
            g = L(7 if law.style == "tait/water" else law.parameter)
            p = c**2 * rho0 / g * ((rho / rho0) ** g - 1)
        return p + L(law.background)

    def density_of(self, i: int, p: Any) -> Any:
        law = self.model.eos[self.t[i] + 1]
        rho0, c = L(law.rho0), L(law.cs)
        p = p - L(law.background)
        if law.style == "linear":
            return rho0 + p / c**2
        if law.style == "cubic":
            y, A = p / c**2, L(law.parameter)
            D = np.sqrt(y**2 / (4 * A**2) + 1 / (27 * A**3))
            return rho0 + np.cbrt(y / (2 * A) + D) + np.cbrt(y / (2 * A) - D)
        if law.style == "ideal/gas":
            return p / ((L(law.parameter) - 1) * self.E[i] / self.m[i])
        g = L(7 if law.style == "tait/water" else law.parameter)
        bracket = 1 + g * p / (c**2 * rho0)
        return rho0 * bracket ** (1 / g) if bracket > 0 else L(0)

    def sound(self, i: int) -> Any:
        law = self.model.eos[self.t[i] + 1]
        if law.style == "ideal/gas":
            return np.sqrt((L(law.parameter) - 1) * self.E[i] / self.m[i])
        return self.c_t[self.t[i]]

    # corrections, walls

    def basis(self, x: Vector) -> Vector:
        u = [c / self.rc for c in x]
        h = [L(1), *u]
        if self.model.order == 2:
            h += [c**2 / 2 for c in u]
            h += [u[a] * u[b] for a, b in itertools.combinations(self.D, 2)]
        return h

    def seen_density(self, i: int) -> Any:
        """Density of a particle for one of the other phase."""
        if self.model.fix.interface_reconstruct and self.solid[i]:
            return max(self.rho0[i], self.rho[i])
        return self.rho[i]

    def pair_densities(self, i: int, j: int) -> tuple[Any, Any]:
        if self.model.fix.interface_reconstruct and self.solid[i] and self.solid[j]:
            return self.rho0[i], self.rho0[j]
        return self.seen_density(i), self.seen_density(j)

    def correct(self) -> None:
        if self.model.order < 1:
            return
        for i in self.N:
            if len(self.pairs[i]) < self.model.fix.zmin:
                continue
            M = None
            for p in self.pairs[i]:
                H = self.basis(p.x)
                weight = self.m[p.j] / self.seen_density(p.j) * p.w
                term = [[weight * a * b for b in H] for a in H]
                M = (
                    term
                    if M is None
                    else [[a + b for a, b in zip(r, s, strict=True)] for r, s in zip(M, term, strict=True)]
                )
            if M is None:
                continue
            inv = inverse(M)
            for k, p in enumerate(self.pairs[i]):
                H = self.basis(p.x)
                g = [-p.w / self.rc * dot(H, inv[1 + a]) for a in self.D]
                self.pairs[i][k] = p._replace(g=g)

    def reconstruct(self) -> None:
        chi = []
        for i in self.N:
            same = sum((p.w for p in self.pairs[i] if self.solid[p.j] == self.solid[i]), L(0))
            every = sum((p.w for p in self.pairs[i]), L(0))
            chi.append(same / every if self.pairs[i] else L(0))
        self.chi = chi
        wall = list(self.rho)
        for s in self.N:
            if not self.solid[s]:
                continue
            top, bottom = L(0), L(0)
            for p in self.pairs[s]:
                if not self.solid[p.j]:
                    f = p.j
                    apart = [a - b for a, b in zip(self.other[f], self.other[s], strict=True)]
                    top += p.w * (self.P(f, self.rho[f]) + self.rho[f] * dot(apart, p.x))
                    bottom += p.w
            wall[s] = max(self.density_of(s, top / bottom), self.rho0[s] / 10) if bottom > 0 else self.rho0[s]
        self.rho = wall

    def slip(self, s: int, f: int) -> Vector:
        """Velocity of a solid as a fluid particle sees it."""
        ds, df = 2 * self.rc * (self.chi[s] - L(0.5)), 2 * self.rc * (self.chi[f] - L(0.5))
        k = max(ds, L(0)) / max(df, np.sqrt(L(3)) / 12 * self.rc)
        return [vs + (vs - vf) * k for vs, vf in zip(self.v[s], self.v[f], strict=True)]

    def pair_velocities(self, i: int, j: int) -> tuple[Vector, Vector]:
        if self.model.fix.interface_reconstruct and self.solid[i] != self.solid[j]:
            return (self.slip(i, j), self.v[j]) if self.solid[i] else (self.v[i], self.slip(j, i))
        return self.v[i], self.v[j]

    def gradients(self) -> None:
        self.G = [[[L(0)] * self.d for _ in self.D] for _ in self.N]
        self.grho = [[L(0)] * self.d for _ in self.N]
        self.gE = [[L(0)] * self.d for _ in self.N]
        for i in self.N:
            for p in self.pairs[i]:
                rho_i, rho_j = self.pair_densities(i, p.j)
                v_i, v_j = self.pair_velocities(i, p.j)
                V = self.m[p.j] / rho_j
                for b in self.D:
                    for a in self.D:
                        self.G[i][a][b] += V * (v_j[a] - v_i[a]) * p.g[b]
                    self.grho[i][b] += V * (rho_j - rho_i) * p.g[b]
                    if self.E is not None:
                        self.gE[i][b] += V * (self.E[p.j] - self.E[i]) * p.g[b]

    # shifting, surfaces

    def shifting(self) -> list[Vector]:
        setting, found = self.model.fix.shift, []
        for i in self.N:
            dv = [L(0)] * self.d
            if not self.solid[i] and str(self.t[i] + 1) not in setting.exclude_types:
                speed = np.sqrt(dot(self.v[i], self.v[i]))
                for p in self.pairs[i]:
                    V = self.m[p.j] / self.seen_density(p.j)
                    weight = V * (1 + (p.w / self.W(self.h)) ** 4 / 5)
                    dv = [a - 2 * self.h * speed * weight * b for a, b in zip(dv, p.gw, strict=True)]
            if setting.scale_cross_type:
                s, cmin, wmin = map(L, setting.scale_cross_type)
                C, same, g = L(0), L(0), [L(0)] * self.d
                for p in self.pairs[i]:
                    V = self.m[p.j] / self.seen_density(p.j)
                    if self.t[p.j] == self.t[i]:
                        same += p.r * p.w if setting.weighs_distance else p.w
                    else:
                        C += V * p.w
                        g = [a + V * b for a, b in zip(g, p.gw, strict=True)]
                if same < wmin:
                    dv = [L(0)] * self.d
                elif cmin <= C and dot(g, g) > 0:
                    size = np.sqrt(dot(g, g))
                    normal = [c / size for c in g]
                    along = dot(normal, dv)
                    dv = [a - (1 - s) * b * along for a, b in zip(dv, normal, strict=True)]
            found.append(dv)
        return found

    def surfaces(self) -> None:
        setting, out = self.model.fix.surface_detection, self.out
        out["surface"], out["surface/n"], out["surface/divr"] = [], [], []
        for i in self.N:
            divr, C = L(0), [L(0)] * self.d
            for p in self.pairs[i]:
                V = self.m[p.j] / self.pair_densities(i, p.j)[1]
                divr -= V * dot(p.x, p.gw)
                C = [a + V * b for a, b in zip(C, p.gw, strict=True)]
            z = len(self.pairs[i])
            low = (z if setting.style == "coordination" else divr) < setting.limit
            kind = 0 if self.solid[i] or not low else 2 if z < setting.splash else 1
            normal = [-c / (np.sqrt(dot(C, C)) + L("1e-10")) for c in C]
            out["surface"].append(kind)
            out["surface/divr"].append(divr)
            out["surface/n"].append(normal if kind == 1 else [L(0)] * self.d)
            if "shift/v" in out:
                dv = out["shift/v"][i]
                if kind == 2:
                    dv = [L(0)] * self.d
                elif kind == 1 and dot(normal, dv) >= 0:
                    dv = [a - b * dot(normal, dv) for a, b in zip(dv, normal, strict=True)]
                out["shift/v"][i] = dv
        out["surface/r"] = []
        for i in self.N:
            r = self.rc
            if not self.solid[i]:
                r = min([r, *(p.r for p in self.pairs[i] if out["surface"][p.j] == 1)])
            out["surface/r"].append(L(0) if out["surface"][i] else r)

    # properties of a particle

    def viscosities(self) -> Vector:
        found = []
        for i in self.N:
            law = self.model.viscosity[self.t[i]]
            eta = L(law.eta)
            if law.style == "power":
                DD = sum(((self.G[i][a][b] + self.G[i][b][a]) / 2) ** 2 for a in self.D for b in self.D)
                rate = np.sqrt(2 * DD)
                if rate > law.gd0:
                    tau0 = eta * L(law.gd0) - L(law.K) * L(law.gd0) ** L(law.n)
                    eta = L(law.K) * rate ** (L(law.n) - 1) + tau0 / rate
            found.append(eta)
        return found

    def temperatures(self) -> Vector:
        found = []
        for i in self.N:
            p = self.model.thermal[self.t[i]]
            e = self.E[i] / self.m[i]
            T = e / L(p.specific_heat)
            if p.T_freeze is not None and p.T_freeze < T:
                T = max(L(p.T_freeze), (e - L(p.latent_heat)) / L(p.specific_heat))
            found.append(T)
        return found

    # force evaluation and step

    def evaluate(self) -> dict[str, Any]:
        fix, out = self.model.fix, {}
        self.out = out
        self.pairs = [self.neighbours(i) for i in self.N]
        out["coordination"] = [len(pairs) for pairs in self.pairs]
        if fix.rho_sum:
            W0 = self.W(L(0))
            self.rho = [
                self.m[i] * W0 + sum((self.m[i if fix.self_mass else p.j] * p.w for p in self.pairs[i]), L(0))
                for i in self.N
            ]
        self.correct()
        self.chi = None
        if fix.interface_reconstruct:
            self.reconstruct()
            out["chi"] = self.chi
        self.gradients()
        out["grad/v"], out["grad/rho"] = self.G, self.grho
        if self.E is not None:
            out["grad/energy"] = self.gE
        if fix.shift:
            out["shift/v"] = self.shifting()
        if fix.surface_detection:
            self.surfaces()
        out["viscosity"] = self.viscosities()
        out["pressure_used"] = [self.P(i, self.rho[i]) for i in self.N]
        if self.E is not None:
            out["temperature"] = self.temperatures()
        self.pair_terms()
        out["rho"] = list(self.rho)
        return out

    def pair_terms(self) -> None:
        model, out = self.model, self.out
        walls, eta, xi, zeta = (
            model.fix.interface_reconstruct,
            out["viscosity"],
            L(model.pair.rho_damp),
            L(model.pair.artificial_viscosity),
        )
        f = [[L(0)] * self.d for _ in self.N]
        push = [[L(0)] * self.d for _ in self.N]
        drho, heat = [L(0)] * self.n, [L(0)] * self.n
        stress = [[[L(0)] * self.d for _ in self.D] for _ in self.N]

        def mean(a: Any, b: Any) -> Any:
            if model.pair.harmonic_means:
                return 2 * a * b / (a + b) if a + b != 0 else L(0)
            return (a + b) / 2

        for i in self.N:
            for p in self.pairs[i]:
                j, x, r, g = p.j, p.x, p.r, p.g
                rho_i, rho_j = self.pair_densities(i, j)
                V_i, V_j = self.m[i] / rho_i, self.m[j] / rho_j
                c = (self.sound(i) + self.sound(j)) / 2
                mixed = self.solid[i] != self.solid[j]
                if self.E is not None:
                    kappa = mean(L(model.thermal[self.t[i]].conductivity), L(model.thermal[self.t[j]].conductivity))
                    T = out["temperature"]
                    heat[i] += 2 * kappa * V_i * V_j * (T[i] - T[j]) * dot(x, g) / r**2
                if self.solid[i] and self.solid[j]:
                    continue
                before = [a + b for a, b in zip(f[i], push[i], strict=True)]
                bracket = self.P(i, self.seen_density(i)) + self.P(j, self.seen_density(j))
                if zeta and not (mixed and walls):
                    v = [a - b for a, b in zip(self.v[i], self.v[j], strict=True)]
                    u = [
                        v[a] - dot([(s + t) / 2 for s, t in zip(self.G[i][a], self.G[j][a], strict=True)], x)
                        for a in self.D
                    ]
                    mu = min(L(0), dot(u, x) / self.h / (r**2 / self.h**2 + L("0.01")))
                    bracket += zeta * (-2 * c * mu + mu**2) * (self.rho[i] + self.rho[j])
                v_i, v_j = self.pair_velocities(i, j)
                viscous = 2 * mean(eta[i], eta[j]) * V_i * V_j * dot(x, g) / r**2
                for a in self.D:
                    push[i][a] -= V_i * V_j * bracket * g[a]
                    f[i][a] += viscous * (v_i[a] - v_j[a])
                if mixed and walls:
                    s = i if self.solid[i] else j
                    if self.chi[s] > L("0.9") and r < self.rc / 2:
                        size = (self.chi[s] - L("0.9")) * (self.rc / 2 - r) * self.rho0[s] * c**2 * self.rc
                        f[i] = [a + size * b / r for a, b in zip(f[i], x, strict=True)]
                for a in self.D:
                    for b in self.D:
                        low, high = min(a, b), max(a, b)
                        stress[i][a][b] -= x[low] * (f[i][high] + push[i][high] - before[high]) / 2
                if xi and not mixed:
                    if model.order >= 1:
                        slope = [(a + b) / 2 for a, b in zip(self.grho[i], self.grho[j], strict=True)]
                        drho[i] -= 2 * xi * V_j * (self.rho[j] - self.rho[i] + dot(slope, x)) * dot(x, g) / r**2
                    else:
                        excess = (self.rho[j] - self.rho0[j]) - (self.rho[i] - self.rho0[i])
                        drho[i] -= 2 * xi * V_j * excess * self.dW(r) / r
        out["stress/atom"] = stress
        f = [[a + b for a, b in zip(u, v, strict=True)] for u, v in zip(f, push, strict=True)]
        self.given = [False] * self.n
        for force in model.forces:
            for i in self.N:
                if force.types is not None and self.t[i] + 1 not in force.types:
                    continue
                for a, value in enumerate(force.vector):
                    if force.style == "gravity":
                        f[i][a] += self.m[i] * L(value)
                    elif force.style == "addforce":
                        f[i][a] += L(value)
                    elif value is not None:
                        f[i][a] = L(value)
                self.given[i] |= force.style == "setforce"
        out["f"], out["drho"], self.push = f, drho, push
        if self.E is not None:
            out["heatflow"] = heat

    def continuity(self, dt: Any) -> None:
        for i in self.N:
            if not self.solid[i]:
                trace = sum(self.G[i][a][a] for a in self.D)
                self.rho[i] += dt / 2 * (self.out["drho"][i] - self.rho[i] * trace)

    def step(self, dt: float) -> None:
        dt, fix = L(dt), self.model.fix
        if not self.out:
            self.evaluate()
        old = self.out
        for i in self.N:  # a
            self.v[i] = [v + dt / 2 * f / self.m[i] for v, f in zip(self.v[i], old["f"][i], strict=True)]
        if fix.interface_reconstruct:  # b
            for i in self.N:
                set_force = self.given[i]  # in which there is no pressure
                self.other[i] = [
                    (f - (0 if set_force else p)) / self.m[i] for f, p in zip(old["f"][i], self.push[i], strict=True)
                ]
            self.reconstruct()
        self.gradients()  # c
        for i in self.N:  # d
            self.x[i] = [x + dt * v for x, v in zip(self.x[i], self.v[i], strict=True)]
        if not fix.rho_sum:  # e
            self.continuity(dt)
        if fix.shift:  # f
            for i in self.N:
                if not self.solid[i]:
                    dv = old["shift/v"][i]
                    self.x[i] = [x + dt * c for x, c in zip(self.x[i], dv, strict=True)]
                    self.v[i] = [v + dt * dot(row, dv) for v, row in zip(self.v[i], self.G[i], strict=True)]
                    if not fix.rho_sum:
                        self.rho[i] += dt * dot(dv, self.grho[i])
                    if self.E is not None:
                        self.E[i] += dt * dot(dv, self.gE[i])
        if self.E is not None:  # g
            self.E = [E + dt / 2 * Q for E, Q in zip(self.E, old["heatflow"], strict=True)]
            T = self.temperatures()
            for i in self.N:
                freezing = self.model.thermal[self.t[i]].T_freeze
                if freezing is not None and T[i] != freezing:
                    self.solid[i] = bool(T[i] < freezing)
        self.evaluate()  # h
        for i in self.N:  # i
            self.v[i] = [v + dt / 2 * f / self.m[i] for v, f in zip(self.v[i], self.out["f"][i], strict=True)]
        if not fix.rho_sum:
            self.continuity(dt)
        if self.E is not None:
            self.E = [E + dt / 2 * Q for E, Q in zip(self.E, self.out["heatflow"], strict=True)]
