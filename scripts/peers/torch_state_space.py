"""PyTorch: neural state space with an encoder of past samples, trained on short stretches by Adam."""

import time

import numpy as np

# Method: G. Beintema, R. Toth, M. Schoukens, Nonlinear state-space identification using deep encoder networks, 2021.
REQUIREMENTS = ["torch>=2.4", "numpy>=1.26"]
PIP_OPTIONS = ["--extra-index-url", "https://download.pytorch.org/whl/cpu"]
STRETCH, BATCH, HIDDEN, RATES = 60, 256, 32, (3e-3, 1e-3, 3e-4)


def fit(data):
    """Minibatches of stretches; the weights whose free run over the last fifth is best are kept."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(data.seed)
    end = time.monotonic() + 0.85 * data.seconds
    nb, nf, nk = data.orders or (2, 3, 1)
    u, y = np.concatenate(data.u), np.concatenate(data.y)
    scale = (u.mean(), u.std() or 1.0, y.mean(), y.std() or 1.0)
    parts = [(delayed((a - scale[0]) / scale[1], nk), (b - scale[2]) / scale[3], ~m)
             for a, b, m in zip(data.u, data.y, data.missing, strict=True)]  # fmt: skip
    n, past = max(nf, nb) + 1, 2 * max(nf, nb) + 3
    held = [tuple(v[-max(len(v) // 5, past + 20) :] for v in part) for part in parts]
    train = [tuple(v[: len(v) - len(v) // 5] for v in part) for part in parts]
    length = min(STRETCH, min(len(a) for a, _, _ in train) - past - 1)
    if length < 10:
        raise NotImplementedError(f"it needs experiments of at least {past + 40} samples")
    net, rng = Net(torch, n, past), np.random.default_rng(data.seed)
    tensors = [[torch.as_tensor(v.astype(np.float32)) for v in part] for part in train]
    chance = np.array([len(a) - past - length for a, _, _ in train], dtype=float)
    best, best_loss, steps, reason = net.model(scale, nk), np.inf, 0, "no better for long at the last rate"
    budget, began = end - time.monotonic(), time.monotonic()
    for phase, rate in enumerate(RATES):
        net.load(best)
        search, waited = torch.optim.Adam(net.parameters(), lr=rate), 0
        until = began + budget * (0.5, 0.8, 1.0)[phase]
        while waited < 15:
            if time.monotonic() > until:
                reason = "time was up"
                break
            for _ in range(40):
                part = tensors[rng.choice(len(train), p=chance / chance.sum())]
                first = torch.as_tensor(rng.integers(0, len(part[0]) - past - length, BATCH))
                window = first[:, None] + torch.arange(past + length)[None]
                a, b, m = (v[window] for v in part)
                error = (net(a, b, length) - b[:, past:]) * m[:, past:]
                loss = (error**2).mean()
                search.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
                search.step()
                steps += 1
            model = net.model(scale, nk)
            now, waited = model.error(held), waited + 1
            if now < best_loss:
                best, best_loss, waited = model, now, 0
    best.details = {"structure": f"order {n}, {HIDDEN} tanh units a map, encoder of {past} samples"}
    best.details |= {"loss": best.error(parts) * scale[3] ** 2, "stop": f"{steps} steps of Adam: {reason}"}
    return best


def delayed(u, nk):
    """The input shifted so that the model's own delay of one sample gives nk."""
    return u[np.clip(np.arange(len(u)) - (nk - 1), 0, len(u) - 1)]


def Net(torch, n, past):
    """A linear part beside a net of one hidden layer, for the next state, the output and the encoder."""
    nn = torch.nn

    class Both(nn.Module):
        def __init__(self, inputs, outputs, gain):
            super().__init__()
            self.one, self.two = nn.Linear(inputs, outputs + HIDDEN), nn.Linear(HIDDEN, outputs, bias=False)
            self.outputs = outputs
            with torch.no_grad():
                self.two.weight *= gain

        def forward(self, x):
            z = self.one(x)
            return z[:, : self.outputs] + self.two(torch.tanh(z[:, self.outputs :]))

    class StateSpace(nn.Module):
        def __init__(self):
            super().__init__()
            self.maps = nn.ModuleList([Both(n + 1, n, 0.1), Both(n, 1, 0.1), Both(2 * past, n, 0.1)])
            with torch.no_grad():  # a slow stable state at first, whose memory reaches over the stretch
                self.maps[0].one.weight[:n, :n] = 0.9 * torch.eye(n)

        def forward(self, u, y, length):
            state, output, encoder = self.maps
            x, states = encoder(torch.cat([y[:, :past], u[:, :past]], dim=1)), []
            # All that does not wait for the state is done at once: this loop is the cost of the method.
            driven = u[:, past:, None] * state.one.weight[:, n] + state.one.bias
            A, B = state.one.weight[:, :n].T, state.two.weight.T
            for now in driven.unbind(1):
                states.append(x)
                z = torch.addmm(now, x, A)
                x = torch.addmm(z[:, :n], torch.tanh(z[:, n:]), B)
            return output(torch.cat(states)).reshape(length, -1).T

        def model(self, scale, nk):
            found = [(each.one.weight, each.one.bias, each.two.weight) for each in self.maps]
            values = [tuple(v.detach().numpy().astype(float).copy() for v in one) for one in found]
            return Simulated(values, past, scale, nk)

        def load(self, model):
            with torch.no_grad():
                for one, values in zip(self.maps, model.maps, strict=True):
                    for place, value in zip((one.one.weight, one.one.bias, one.two.weight), values, strict=True):
                        place.copy_(torch.as_tensor(value))

    return StateSpace()


def layer(x, first, bias, second):
    z, n = first @ x + bias, len(second)
    return z[:n] + second @ np.tanh(z[n:])


class Simulated:
    """The trained model in numpy, where one sample costs a tenth of what it does in torch."""

    def __init__(self, maps, past, scale, nk):
        self.maps, self.past, self.scale, self.nk = maps, past, scale, nk

    def free_run(self, u, first):
        """Output (N,), which repeats the first `past` ones, from which the encoder makes the state."""
        state, output, encoder = (lambda x, m=m: layer(x, *m) for m in self.maps)
        out = np.concatenate([first[: self.past], np.zeros(len(u) - self.past)])
        with np.errstate(all="ignore"):
            x = encoder(np.concatenate([first[: self.past], u[: self.past]]))
            for k in range(self.past, len(u)):
                out[k] = output(x)[0]
                x = state(np.append(x, u[k]))
        return out

    def error(self, parts):
        """Mean squared error of the free run over experiments (u, y, measured)."""
        errors = np.concatenate([(self.free_run(u, y) - y)[self.past :][m[self.past :]] for u, y, m in parts])
        return float(np.nan_to_num(np.mean(errors**2), nan=np.inf))

    def simulate(self, u, y_init):
        u0, su, y0, sy = self.scale
        u, first = delayed((u - u0) / su, self.nk), (y_init - y0) / sy
        if len(first) > self.past:  # the state is made as late as the known outputs allow
            skip = len(first) - self.past
            run = self.free_run(u[skip:], first[skip:])
            return y0 + sy * np.concatenate([first[:skip], run])
        added = self.past - len(first)
        first = np.concatenate([np.full(added, first[0] if len(first) else 0.0), first])
        return (y0 + sy * self.free_run(np.concatenate([np.full(added, u[0]), u]), first))[added:]
