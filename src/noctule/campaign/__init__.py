"""Many flights over the cores of one machine."""

from noctule.campaign.seeds import CampaignError, fly_seeds

__all__ = ["CampaignError", "fly_seeds"]
