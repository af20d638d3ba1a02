//! The `artitwin` command.

fn main() -> std::process::ExitCode {
    artitwin::cli::main()
}
