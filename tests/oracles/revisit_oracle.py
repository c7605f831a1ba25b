"""The slow and obvious way to count revisits: every drawn place is watched, sample by sample, in plain Python."""

import math


def visits_slowly(points, drawn, limit, radius=5e-3):
    """Visits before the places that are drawn, and the samples waited for them or in vain; foci take turns.

    points: in the hand frame, [sample][focus]; drawn: alike, whether each is. limit: samples of a wait in vain.
    """
    visits = waited = 0
    for now, places in enumerate(points):
        focus = now % len(places)
        if drawn[now][focus]:
            found = wait_slowly(points, drawn, limit, radius, now, places[focus])
            visits += found is not None and found[0]
            waited += 0 if found is None else found[1]
    return visits, waited


def wait_slowly(points, drawn, limit, radius, now, place):
    own, before, left = [], [], False
    for sample in range(now, -1, -1):
        away = [math.dist(p, place) for p, d in zip(points[sample], drawn[sample], strict=True) if d]
        if not away:
            continue
        if min(away) < radius:
            if left and (before or sample >= own[-1][1] - limit):
                before.append((min(away), sample))
            elif not left:
                own.append((min(away), sample))
        elif before:
            break
        else:
            left = True
    entered = own[-1][1]
    before = [visit for visit in before if visit[1] >= entered - limit]
    if now - entered > limit:
        return None
    if before:
        return True, min(own)[1] - min(before)[1]  # of equal distances the first sample
    if entered < limit:
        return None
    lookable = [s for s in range(entered - limit, entered + 1) if any(drawn[s])]
    return False, entered - lookable[0]
