// arduino-cli compiles a sketch only if this file is here; all code is in the .c files beside it.
