"""Records whose fields state their shapes."""

from typing import NamedTuple

import numpy as np

from pinfric.kernels.arrays import array, make


class Buffers(NamedTuple):
    """Buffers of all kinds."""

    still: np.ndarray = array("n 3", bool)
    index: np.ndarray = array("1", np.int64, 7)
    least: np.ndarray = array("n columns", fill=-np.inf)
    whatever: np.ndarray = array("n", fill=None)


def test_each_array_has_the_shape_type_and_first_value_of_its_field():
    made = make(Buffers, n=2, columns=4)
    assert [x.shape for x in made] == [(2, 3), (1,), (2, 4), (2,)]
    assert [x.dtype for x in made] == [np.dtype(kind) for kind in (bool, np.int64, float, float)]
    assert not made.still.any()
    assert made.index[0] == 7
    assert (made.least == -np.inf).all()
    assert all(x.flags.c_contiguous and x.flags.owndata for x in made)  # of one type for kernels
    assert make(Buffers, n=1, columns=0).least.shape == (1, 0)
