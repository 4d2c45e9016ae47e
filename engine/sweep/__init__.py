"""Many renders of one patch."""
