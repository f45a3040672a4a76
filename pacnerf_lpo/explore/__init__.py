"""A model, a measurement and their error side by side, changed by hand or by a script and simulated at once."""

from pacnerf_lpo.explore import records
from pacnerf_lpo.explore.session import Session
