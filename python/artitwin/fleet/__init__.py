"""Many recordings on a Ray cluster: `artitwin fleet` (docs/fleet.md).

Needs the extra `artitwin[fleet]`. The rest of the package does not know this part, and ray is imported only
where a cluster is used (`cluster.py`, `metrics.py`).
"""
