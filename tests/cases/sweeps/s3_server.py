"""An object store of this machine: moto's server, which speaks S3."""

import contextlib
import socket
import subprocess
import sys
import time
import urllib.request

import pytest

SERVER = "from moto.server import main; main()"


@contextlib.contextmanager
def s3_bucket(patch):
    """URL of a bucket; the environment that s3fs needs is set by `patch`, for child processes, too."""
    pytest.importorskip("moto")
    fsspec = pytest.importorskip("fsspec")
    pytest.importorskip("s3fs")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    keys = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_DEFAULT_REGION": "us-east-1"}
    keys["AWS_ENDPOINT_URL"] = f"http://127.0.0.1:{port}"
    for name, value in keys.items():
        patch.setenv(name, value)
    words = [sys.executable, "-c", SERVER, "-H", "127.0.0.1", "-p", str(port)]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            until = time.monotonic() + 60
            while True:
                with contextlib.suppress(OSError):
                    urllib.request.urlopen(keys["AWS_ENDPOINT_URL"], timeout=1).close()
                    break
                assert time.monotonic() < until
                time.sleep(0.1)
            fsspec.filesystem("s3", skip_instance_cache=True).mkdir("palpate")  # others were of earlier servers
            yield "s3://palpate"
        finally:
            server.kill()  # also after a failure, as the end of `with` waits for it
