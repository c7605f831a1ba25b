"""Bytes on disk: durable files, HDF5 and SQLite opened strictly, checksums and digests."""
