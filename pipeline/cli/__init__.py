"""The command line: parsing here, each command's action in a module of its own, imported only when it is called."""
