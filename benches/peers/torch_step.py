"""The step of `benches/step.rs` in PyTorch: same shapes, tensor operations, autograd, Adam. Prints one JSON line.

`python torch_step.py [cpu|cuda]`
"""

import json
import os
import statistics
import sys
import time

import torch

POINTS, PER_RAY, LEVELS, ENTRIES = 65_536, 16, 16, 1 << 17
PRIMES = (1, 2_654_435_761, 805_459_861)


class Field(torch.nn.Module):
    def __init__(self):
        super().__init__()
        growth = (512 / 16) ** (1 / (LEVELS - 1))
        self.scales = [16 * growth**level - 1 for level in range(LEVELS)]
        self.table = torch.nn.ParameterList([torch.nn.Parameter(torch.rand(ENTRIES, 2) * 2e-4 - 1e-4) for _ in range(LEVELS)])
        layers = lambda *widths: torch.nn.Sequential(
            *[m for i, o in zip(widths, widths[1:]) for m in (torch.nn.Linear(i, o), torch.nn.ReLU())][:-1])
        self.geometry, self.color = layers(2 * LEVELS, 64, 16), layers(15 + 16, 64, 64, 3)

    def encode(self, points):
        features = []
        for scale, table in zip(self.scales, self.table):
            position = points * scale + 0.5
            cell = position.floor()
            fraction, cell = position - cell, cell.long()
            sum_ = 0
            for corner in range(8):
                d = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2], device=points.device)
                weight = torch.where(d.bool(), fraction, 1 - fraction).prod(1, keepdim=True)
                node = cell + d
                side = int(scale) + 3
                if side**3 <= ENTRIES:
                    entry = (node[:, 2] * side + node[:, 1]) * side + node[:, 0]
                else:
                    entry = (node[:, 0] ^ node[:, 1] * PRIMES[1] ^ node[:, 2] * PRIMES[2]) & (ENTRIES - 1)
                sum_ = sum_ + weight * table[entry]
            features.append(sum_)
        return torch.cat(features, 1)

    def forward(self, points, views):
        outputs = self.geometry(self.encode(points))
        return outputs[:, :1], torch.sigmoid(self.color(torch.cat([views, outputs[:, 1:]], 1)))


def main():
    device = sys.argv[1] if len(sys.argv) > 1 else "cpu"
    wait = torch.cuda.synchronize if device == "cuda" else lambda: None
    torch.manual_seed(1)
    torch.set_num_threads(os.cpu_count() or 1)
    field = Field().to(device)
    adam = torch.optim.Adam(field.parameters(), lr=0.01, eps=1e-15)
    points, views = torch.rand(POINTS, 3, device=device), torch.rand(POINTS, 16, device=device)
    targets, colors = torch.rand(POINTS, 1, device=device), torch.rand(POINTS // PER_RAY, 3, device=device)
    seconds = []
    for _ in range(7 if device == "cpu" else 100):
        wait()
        begin = time.perf_counter()
        tsdf, rgb = field(points, views)
        rendered = rgb.reshape(-1, PER_RAY, 3).mean(1)
        loss = (tsdf - targets).square().mean() + 10 * (rendered - colors).square().mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
        wait()
        seconds.append(time.perf_counter() - begin)
    where = "CPU" if device == "cpu" else torch.cuda.get_device_name()
    name = f"PyTorch {torch.__version__.split('+')[0]}, {where}"
    print(json.dumps({"engine": name, "step_ms": 1e3 * min(seconds[2:]), "median_ms": 1e3 * statistics.median(seconds[2:])}))


if __name__ == "__main__":
    main()
