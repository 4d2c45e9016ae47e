"""Sound files: where a sound begins and ends in its file, how loud it is, and what the file says of itself."""
