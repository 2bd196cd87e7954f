"""What every test shares: small hypothesis runs by default, so that the whole suite stays quick on two cores."""

from hypothesis import HealthCheck, settings

settings.register_profile("quick", max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("quick")
