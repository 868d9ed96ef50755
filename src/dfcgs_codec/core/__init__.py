"""The C core, as a WebAssembly module that `wasmtime` runs (spec sections 3 to 19, profile `main`)."""
