"""Quasi-static deformation of a nearly incompressible soft solid, with exact surface truth.

The displacement is a cubic B-spline field on a coarse lattice (C2, so that shading has no creases); the energy is stable
Neo-Hookean (Smith et al. 2018) at quadrature points inside the organ; L-BFGS preconditioned by one factorised Laplacian.
Lengths in mm, shear modulus 1."""

import itertools

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

POISSON = 0.47
NODES, POINTS = 1500, 5000  # aimed numbers of lattice nodes and of quadrature points


def cubic(f):
    """Weights of the four B-splines at fractions f (n,) and their derivatives: (n, 4), (n, 4)."""
    g = 1 - f
    w = [g**3, 3 * f**3 - 6 * f**2 + 4, 3 * g**3 - 6 * g**2 + 4, f**3]
    d = [-3 * g**2, 9 * f**2 - 12 * f, -9 * g**2 + 12 * g, 3 * f**2]
    return np.stack(w, -1) / 6, np.stack(d, -1) / 6


class Solid:
    """The organ's inside. `surface` (n, 3): rest vertices that follow the field."""

    def __init__(self, sdf, surface, voxel):
        inside = np.argwhere(sdf.grid < 0)
        volume = len(inside) * voxel**3
        step = max(1, int(round((volume / POINTS) ** (1 / 3) / voxel)))
        self.q = inside[(inside % step == 0).all(1)] * voxel + sdf.low
        self.vol = np.full(len(self.q), volume / len(self.q))
        self.h = max((2.2 * volume / NODES) ** (1 / 3), 4.0)
        self.x0 = surface
        self.low = np.minimum(surface.min(0), self.q.min(0)) - 2 * self.h
        self.size = np.ceil((np.maximum(surface.max(0), self.q.max(0)) + 3 * self.h - self.low) / self.h).astype(int)
        value, grad = self.basis(self.q)
        surf, _ = self.basis(surface)
        used = np.unique(np.concatenate([value.indices, surf.indices]))
        self.value, self.surf = value[:, used].tocsr(), surf[:, used].tocsr()
        self.grad = [g[:, used].tocsr() for g in grad]
        self.n = len(used)
        self.mu, self.lam = 1.0, 2 * POISSON / (1 - 2 * POISSON)
        self.alpha = 1 + self.mu / self.lam
        w = sp.diags(self.vol)
        self.stiff = sum(g.T @ w @ g for g in self.grad)
        # Nodes that carry little volume are held to their neighbours.
        ijk = np.stack(np.unravel_index(used, self.size), -1)
        index = np.full(self.size, -1)
        index[tuple(ijk.T)] = np.arange(self.n)
        rows = []
        for a in range(3):
            up = np.minimum(ijk + np.eye(3, dtype=int)[a], np.array(self.size) - 1)
            j = index[tuple(up.T)]
            ok = (j >= 0) & (j != np.arange(self.n))
            rows.append(sp.csr_matrix(self.pairs(np.where(ok)[0], j[ok])))
        self.hold = 2e-3 * self.h * sum(r.T @ r for r in rows)
        self.transposed = [g.T.tocsr() for g in self.grad]

    def pairs(self, i, j):
        """Difference operator (len(i), n) with rows u_i - u_j."""
        k = np.arange(len(i))
        return sp.coo_matrix((np.r_[np.ones(len(i)), -np.ones(len(i))], (np.r_[k, k], np.r_[i, j])), (len(i), self.n))

    def basis(self, p):
        """Sparse value (n, nodes) and the three gradient matrices of the lattice splines at points p (n, 3)."""
        u = (p - self.low) / self.h
        cell = np.floor(u).astype(int)
        w, d = zip(*(cubic(u[:, a] - cell[:, a]) for a in range(3)))
        cols, vals = [], [[], [], [], []]
        for k in itertools.product(range(4), repeat=3):
            cols.append(np.ravel_multi_index(tuple((cell + np.array(k) - 1).T), self.size))
            wk = [w[a][:, k[a]] for a in range(3)]
            dk = [d[a][:, k[a]] / self.h for a in range(3)]
            vals[0].append(wk[0] * wk[1] * wk[2])
            vals[1].append(dk[0] * wk[1] * wk[2])
            vals[2].append(wk[0] * dk[1] * wk[2])
            vals[3].append(wk[0] * wk[1] * dk[2])
        rows = np.tile(np.arange(len(p)), 64)
        made = [
            sp.csr_matrix((np.concatenate(v), (rows, np.concatenate(cols))), (len(p), int(np.prod(self.size))))
            for v in vals
        ]
        return made[0], made[1:]

    def energy(self, u, forces):
        """Energy and gradient (n, 3) of nodal displacements u; also the volume ratio J of every quadrature point."""
        f = np.stack([g @ u for g in self.grad], -1) + np.eye(3)  # f[q, a, b] = d x_a / d X_b
        c0, c1, c2 = f[:, :, 0], f[:, :, 1], f[:, :, 2]
        cof = np.stack([np.cross(c1, c2), np.cross(c2, c0), np.cross(c0, c1)], -1)
        j = (cof[:, :, 0] * c0).sum(1)
        e = (self.vol * (0.5 * self.mu * ((f**2).sum((1, 2)) - 3) + 0.5 * self.lam * (j - self.alpha) ** 2)).sum()
        p = (self.mu * f + (self.lam * (j - self.alpha))[:, None, None] * cof) * self.vol[:, None, None]
        grad = sum(g @ p[:, :, b] for b, g in enumerate(self.transposed))
        held = self.hold @ u
        e += 0.5 * (u * held).sum()
        grad += held
        for force in forces:
            fe, fg = force(u)
            e += fe
            grad += fg
        return e, grad, j

    def springs(self, target, weight):
        """Force that draws quadrature points to `target` (q, 3) by springs of stiffness `weight` (q,) per volume."""
        on = np.where(weight > 0)[0]
        b, k, want = self.value[on], (weight * self.vol)[on], (target - self.q)[on]
        bt = b.T.tocsr()

        def force(u):
            r = b @ u - want
            return 0.5 * (k[:, None] * r**2).sum(), bt @ (k[:, None] * r)

        force.diagonal = np.asarray(abs(bt) @ k)
        return force

    def solve(self, u, forces, rounds=80, tolerance=1e-2):
        """Minimise from u; returns displacements of the nodes, the number of rounds and the least volume ratio."""
        d = 1e-6 + sum(f.diagonal for f in forces)
        lu = spl.splu(((self.mu + 0.5 * self.lam) * self.stiff + self.hold + sp.diags(d)).tocsc())
        memory = []
        e, g, j = self.energy(u, forces)
        for done in range(1, rounds + 1):
            q, a = g.copy(), []
            for s, y, rho in reversed(memory):
                a.append(rho * (s * q).sum())
                q -= a[-1] * y
            q = lu.solve(q)
            for (s, y, rho), ai in zip(memory, reversed(a)):
                q += s * (ai - rho * (y * q).sum())
            slope, step = -(g * q).sum(), 1.0
            while True:
                un = u - step * q
                en, gn, j = self.energy(un, forces)
                if en <= e + 1e-4 * step * slope or step < 1e-4:
                    break
                step *= 0.5
            s, y = un - u, gn - g
            if (s * y).sum() > 1e-12:
                memory = (memory + [(s, y, 1 / (s * y).sum())])[-15:]
            u, e, g = un, en, gn
            if np.abs(s).max() < tolerance and step > 0.4 or step < 1e-4:
                break
        return u, done, j.min()

    def vertices(self, u):
        """Deformed surface vertices (n, 3), mm."""
        return self.x0 + self.surf @ u
