"""What scripts and notebooks call: names instead of objects; batches that show, sample, play and save themselves."""
