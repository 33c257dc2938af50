//! Parses the command line, runs one command, and turns its outcome into the contract's exit status.

fn main() -> std::process::ExitCode {
    sweetspot::cli::main()
}
