"""Where the host's sampler enters the contours of poses."""

from contour_shapes import still

from palpate.render.sampling import sampler
from palpate.render.sampling.contour_sampling import Sampler, sample_contours


def entered_by_host(batch, time, duration, strategy, monkeypatch):
    """Track, knot, index and number of the first sample on each pose's contours that the host's sampler enters."""
    found, taken = [], [0]
    enter, advance = Sampler._enter, Sampler._advance

    def noted(self, path, silent):
        cursor = enter(self, path, silent)
        found.append((cursor.track, cursor._anchor, cursor._index, taken[0]))
        return cursor

    def counted(self, count, gain):
        taken[0] += count
        return advance(self, count, gain)

    def rested(self, count):
        taken[0] += count
        return rest(self, count)

    rest = Sampler._rest
    monkeypatch.setattr(sampler.Sampler, "_enter", noted)
    monkeypatch.setattr(sampler.Sampler, "_advance", counted)
    monkeypatch.setattr(sampler.Sampler, "_rest", rested)
    list(sample_contours([batch], still(len(time)), time, duration, Sampler(strategy)))
    return found
