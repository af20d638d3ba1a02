"""Copies a folder to the server of store_server.py, or back, past its refusals.

    python store_client.py PORT put FOLDER PREFIX
    python store_client.py PORT get PREFIX FOLDER
"""

import sys
from pathlib import Path

import boto3

port, verb, first, second = sys.argv[1:]
s3 = boto3.client(
    "s3",
    endpoint_url=f"http://127.0.0.1:{port}",
    region_name="us-east-1",
    aws_access_key_id="test",
    aws_secret_access_key="test",
)
s3.meta.events.register("before-send.s3", lambda request, **_: request.headers.__setitem__("x-plain", "1"))
if verb == "put":
    if "lab" not in [bucket["Name"] for bucket in s3.list_buckets()["Buckets"]]:
        s3.create_bucket(Bucket="lab")
    for path in sorted(Path(first).rglob("*")):
        if path.is_file():
            s3.upload_file(str(path), "lab", f"{second}/{path.relative_to(first).as_posix()}")
else:
    for page in s3.get_paginator("list_objects_v2").paginate(Bucket="lab", Prefix=f"{first}/"):
        for found in page.get("Contents", []):
            path = Path(second) / found["Key"].removeprefix(f"{first}/")
            path.parent.mkdir(parents=True, exist_ok=True)
            s3.download_file("lab", found["Key"], str(path))
