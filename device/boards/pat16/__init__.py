"""UCL's OpenMPD board behind an FT232H: link, board file, model."""
