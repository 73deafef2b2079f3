"""Stage in, layer out, for every host: the command line, an add-on, a worker, a script."""
