"""Cores that a process may use, where a container has a quota of them."""

import pytest

from cusick_bench.runner import environment
from cusick_bench.runner.environment import cores


@pytest.mark.parametrize(
    ("memberships", "quotas", "expected"),
    [
        ("0::/\n", {"cpu.max": "200000 100000"}, 2),
        ("0::/job/step\n", {"job/cpu.max": "150000 100000", "job/step/cpu.max": "max 100000"}, 2),
        ("0::/job/step\n", {"job/cpu.max": "800000 100000", "job/step/cpu.max": "30000 100000"}, 1),
        ("3:cpuset:/\n2:cpu,cpuacct:/\n0::/\n", {"cpu,cpuacct/cpu.cfs_quota_us": "300000"}, 3),
        ("1:cpu:/pod\n", {"cpu/pod/cpu.cfs_quota_us": "-1"}, 8),
        ("0::/\n", {"cpu.max": "900000 100000"}, 8),
        ("0::/../outside\n", {}, 8),
        ("", {}, 8),
    ],
)
def test_a_containers_quota_counts(tmp_path, monkeypatch, memberships, quotas, expected):
    for name, quota in quotas.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(quota + "\n")
        file.with_name("cpu.cfs_period_us").write_text("100000\n")
    (tmp_path / "memberships").write_text(memberships)
    monkeypatch.setattr(environment, "_GROUPS", tmp_path)
    monkeypatch.setattr(environment, "_MEMBERSHIPS", tmp_path / "memberships")
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(8)), raising=False)
    assert cores() == expected
