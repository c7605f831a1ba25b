"""`poses.h5` as an earlier palpate wrote it: an HDF5 table whose dimension has a length and no values."""

import h5py
import numpy as np

from palpate.datasets.storage.content_digest import content_trailer
from palpate.datasets.storage.hdf5_columns import image_of, new_image, put_column

NO_COORDINATE = "This is a netCDF dimension but not a netCDF variable. {:10d}"
TRAILER = "BLAKE2b-256 behind the HDF5 file"


def write_old_table(path, columns, attributes, units=None):
    count = len(next(iter(columns.values())))
    with new_image() as file:
        for key, value in {"format": "palpate table", "version": 1, **attributes, "digest": TRAILER}.items():
            file.attrs[key] = value
        scale = file.create_dataset("row", shape=(count,), dtype=">f4", track_times=False)
        assert isinstance(scale, h5py.Dataset)
        scale.make_scale(NO_COORDINATE.format(count))
        for name, column in columns.items():
            put_column(file, name, np.asarray(column), (units or {}).get(name, "")).dims[0].attach_scale(scale)
        image = bytes(image_of(file))
    path.write_bytes(image + content_trailer("table", 1, image))
