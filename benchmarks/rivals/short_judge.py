"""A judge in a hundred lines, to compare with rpil.inference: two rankings averaged, one rule for verdicts, one regression for answers.

j = Judge(X, A, ep)         observations (N, D), actions (N,) classes or (N, K), episode of each step 0..M-1
j.rank, j.verdicts          without answers: "similar", "outlier", "open"
j.answered({m: 1 or 0})     P(good) of all, verdicts "good", "bad", "open"
"""

import numpy as np
from scipy.special import expit
from scipy.stats import norm, rankdata
from sklearn.decomposition import PCA
from sklearn.ensemble import IsolationForest
from sklearn.linear_model import LogisticRegression, Ridge

KEEP, FOLDS, STEPS = 0.6, 5, 12_000  # share that teaches, folds, steps that teach at most
MIN_GAP, MIN_LOW = 4.0, 1 / 3  # robust deviations below the middle; place in the forest's ranking
PRIOR, PRECISION, SURE, MIN_GAIN, SHARP = (
    1.0,
    1.0,
    0.9,
    0.45,
    2.0,
)  # ranking beforehand, ridge, P of a word, nats by which answers must agree, sharpness


def scaled(Z):
    s = Z.std(0)
    return (Z - Z.mean(0))[:, s > 1e-9] / s[s > 1e-9]


def scores(v):
    return norm.ppf((rankdata(v) - 0.5) / len(v))


def summaries(X, A, ep):
    """Length, and of each column mean, deviation, first, last and mean change."""
    out = []
    for m in range(ep.max() + 1):
        x, a = X[ep == m], A[ep == m]
        change = lambda z: np.abs(np.diff(z, axis=0)).mean(0) if len(z) > 1 else np.zeros(z.shape[1])
        out.append(np.r_[np.log(len(x)), x.mean(0), x.std(0), x[0], x[-1], change(x), a.mean(0), a.std(0), change(a)])
    return np.nan_to_num(np.array(out))


def held_out(X, A, ep, teach, fold, rng):
    """Log-probability of each step by a policy of the demonstrations `teach` in the other folds."""
    out = np.zeros(len(X))
    for k in range(fold.max() + 1):
        test = fold[ep] == k
        at = np.flatnonzero(teach[ep] & ~test)
        at = rng.choice(at, STEPS, replace=False) if len(at) > STEPS else at
        if A.ndim == 1:
            P = np.full((test.sum(), A.max() + 1), 1e-3)
            if len(np.unique(A[at])) > 1:
                fit = LogisticRegression(C=1.0, max_iter=100).fit(X[at], A[at])
                P[:, fit.classes_] = np.clip(fit.predict_proba(X[test]), 1e-3, 1)
            out[test] = np.log(P[np.arange(test.sum()), A[test]])
        else:
            fit = Ridge(1.0).fit(X[at], A[at])
            scale = 1.35 * np.median(np.abs(A[at] - fit.predict(X[at]).reshape(len(at), -1)), 0) + 0.03
            out[test] = -(
                2.5 * np.log1p(((A[test] - fit.predict(X[test]).reshape(test.sum(), -1)) / scale) ** 2 / 4)
                + np.log(scale)
            ).sum(1)
    return out


class Judge:
    def __init__(self, X, A, ep, seed=0):
        rng, n = np.random.default_rng(seed), np.bincount(ep)
        X = scaled(np.nan_to_num(np.asarray(X, float)))
        X = PCA(60, random_state=0).fit_transform(X) if X.shape[1] > 60 else X
        X = X if X.shape[1] else np.zeros((len(ep), 1))
        one_hot = np.eye(A.max() + 1)[A] if A.ndim == 1 else scaled(A)
        A = A if A.ndim == 1 else one_hot
        fold, teach = rng.permutation(len(n)) % FOLDS, np.ones(len(n), bool)
        for _ in range(3):
            self.fit = np.bincount(ep, held_out(X, A, ep, teach, fold, rng)) / n
            teach = self.fit >= np.quantile(self.fit, 1 - KEEP)
        F = scaled(summaries(X[:, :30], one_hot[:, :40], ep))
        self.forest = IsolationForest(random_state=seed).fit(F).score_samples(F)
        self.rank = scores(self.fit) + scores(self.forest)
        z = (self.fit - np.median(self.fit)) / (1.4826 * np.median(np.abs(self.fit - np.median(self.fit))) + 1e-9)
        low = (z < -MIN_GAP) & (rankdata(self.forest) <= MIN_LOW * len(n))
        few = 2 <= low.sum() <= len(n) / 3
        self.verdicts = np.where(low & few, "outlier", np.where((self.rank > 0) & (z > -1) & few, "similar", "open"))
        C = PCA(min(8, F.shape[1], len(F) - 1), random_state=0).fit_transform(F)
        self.columns = np.c_[
            np.ones(len(n)), scores(self.rank), scores(self.fit), scores(self.forest), scores(n), C / C.std(0)[:1]
        ]

    def posterior(self, at, y):
        """P(good) of all: logistic regression with a normal prior, the mean of which says that those that agree are good."""
        Z, W = self.columns, np.full(self.columns.shape[1], PRECISION)
        mean = np.zeros(len(W))
        mean[1], W[0] = PRIOR, 0.25
        free = slice(None) if 0 < np.mean(y) < 1 else slice(0, 1)  # one side alone moves the offset
        w = mean.copy()
        for _ in range(30):
            p = np.clip(expit(Z[at] @ w), 1e-6, 1 - 1e-6)
            g, H = Z[at].T @ (y - p) - W * (w - mean), (Z[at].T * (p * (1 - p))) @ Z[at] + np.diag(W)
            step = np.linalg.solve(H[free, free], g[free])
            w[free] += step * min(1, 2 / (np.abs(step).max() + 1e-9))
        V = np.linalg.inv(H)
        return expit(SHARP * Z @ w / np.sqrt(1 + np.pi / 8 * np.einsum("ij,jk,ik->i", Z, V, Z)))

    def answered(self, labels):
        at, y = np.array(list(labels)), np.array(list(labels.values()), float)
        P, v = self.posterior(at, y), np.full(len(self.rank), "open", dtype="<U7")
        if len(at) >= 2 and 0 < y.mean() < 1:
            left = np.array([self.posterior(np.delete(at, i), np.delete(y, i))[at[i]] for i in range(len(at))])
            base = (y.sum() - y + 0.5) / len(y)
            ll = lambda q: np.mean(np.log(np.clip(np.where(y == 1, q, 1 - q), 0.02, 1)))
            if ll(left) > ll(base) + MIN_GAIN:
                v[P >= SURE], v[P <= 1 - SURE] = "good", "bad"
        v[at] = np.where(y == 1, "good", "bad")
        return P, v
