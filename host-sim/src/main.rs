//! The `schuler` command.

fn main() -> std::process::ExitCode {
    host_sim::command::main()
}
