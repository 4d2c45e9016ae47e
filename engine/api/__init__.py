"""What `import engine` adds to the parts: renderings that draw, save and show themselves."""
