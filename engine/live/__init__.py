"""A scene that is played while events come: player, audio thread, MIDI, devices."""
