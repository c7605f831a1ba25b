"""The fictional board `emulator` (docs/formats/emulator.md): link and model."""
