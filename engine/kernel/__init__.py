"""The compiled simulation. It knows nothing of files, patches or Python objects."""
