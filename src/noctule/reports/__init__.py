"""Reports: what a flight did, as one page and its figures, from the recording alone."""

from noctule.reports.campaign_report import CampaignResultsError, write_campaign_report
from noctule.reports.flight_report import ReportWriteError, write_report
from noctule.reports.loading import EmptyRecordingError, load_flight_log
from noctule.reports.poster import poster

__all__ = [
    "CampaignResultsError",
    "EmptyRecordingError",
    "ReportWriteError",
    "load_flight_log",
    "poster",
    "write_campaign_report",
    "write_report",
]
