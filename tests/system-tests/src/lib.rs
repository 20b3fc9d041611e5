//! Process tests: real binaries, real zenoh, kill -9.
