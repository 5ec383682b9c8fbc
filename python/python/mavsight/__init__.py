"""Sessions and poses into motion, and campaigns of simulated flights on one machine or many.

>>> motion, parameters, notes = mavsight.run("flight/session.toml")
>>> motion = mavsight.smooth(t_s, pose, std)            # arrays of n times, n x 6 poses and their standard deviations
>>> velocity = motion.state[:, 6:9]; velocity_std = motion.std[:, 6:9]
>>> campaign = mavsight.Campaign("campaign.toml")
>>> combination, estimates, stds = campaign.estimates(0, 100)
"""

from ._mavsight import Campaign, Motion, run, smooth

__all__ = ["Campaign", "Motion", "run", "run_on", "smooth"]

_planned = {}


def _rows(path, start, stop):
    """Rows of some flights; a worker plans a campaign once."""
    if path not in _planned:
        _planned[path] = Campaign(path)
    return _planned[path].rows(start, stop)


def run_on(client, path, batch=500):
    """The whole table of a campaign, flown by the workers of a Dask client.

    Every worker must find the campaign file, and what it names, under the same path. The table is, byte for byte, that of
    `mavsight campaign`, whatever the number of workers: each flight draws from its own number.
    """
    path = str(path)
    campaign = Campaign(path)
    starts = range(0, len(campaign), batch)
    futures = [client.submit(_rows, path, k, k + batch, pure=False) for k in starts]
    return campaign.header + "".join(client.gather(futures))
