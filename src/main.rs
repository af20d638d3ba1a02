//! The `artitwin` command.

fn main() -> std::process::ExitCode {
    artitwin::main()
}
