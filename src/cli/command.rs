//! The verbs.

use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;

#[cfg(feature = "node")]
use super::args::{NodeArgs, RecordArgs};
use super::{
    args::{
        CheckArgs, DemoArgs, DiagnoseArgs, EvaluateArgs, InspectArgs, ReconstructArgs, SettingArgs,
        SynthArgs, TrackArgs,
    },
    board::BoardArgs,
    gallery::GalleryArgs,
    joint::JointArgs,
    trials::TrialsArgs,
};

const EXIT_CODES: &str = "Exit codes: 0 done, 1 failed, 2 wrong usage or configuration, 3 done but degraded, \
    75 a disk or another process was in the way and may not be later, 130 stopped.";

/// RGB-D recordings of an articulated object in two or more states in, a digital twin that simulators load
/// out.
#[derive(Debug, Parser)]
#[command(name = "artitwin", version, about, after_help = EXIT_CODES, propagate_version = true)]
pub(super) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// One verb, one file.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Make the twin of a recorded object: part meshes, joints, URDF, report
    Reconstruct(Box<ReconstructArgs>),
    /// Show what a recording holds and what it lacks
    Inspect(InspectArgs),
    /// Track the camera of a recording by what it sees, and print its poses
    Track(TrackArgs),
    /// Write a page with a board of tags to print, which gives recordings their scale and world
    Board(BoardArgs),
    /// Measure finished runs against the truth
    Evaluate(EvaluateArgs),
    /// Run methods on objects with their truth, some seeds each, and write their tables
    Trials(TrialsArgs),
    /// Find what would keep a simulator from loading a URDF folder as it is meant
    Check(CheckArgs),
    /// Find where a twin and recorded motion disagree, name the missing effect, update the twin
    Diagnose(DiagnoseArgs),
    /// Find the joint behind recorded paths of a tag, a tracker or a gripper on its part
    Joint(JointArgs),
    /// Let a robot open and close a twin in MuJoCo by contact alone, and film it; needs Python
    Demo(DemoArgs),
    /// Make an articulated object and film it: recordings of two states with their truth
    Synth(SynthArgs),
    /// Run as a ROS 2 node: collect both states from topics, make the twin, publish it
    #[cfg(feature = "node")]
    Node(NodeArgs),
    /// Write the topics that the node would read to a bag, until Ctrl-C
    #[cfg(feature = "node")]
    Record(RecordArgs),
    /// Show the configuration that would be used
    Config {
        /// What to do.
        #[command(subcommand)]
        command: ConfigCommand,
    },
    /// Make one page of the results in some folders, with pictures, verdicts and links
    Gallery(GalleryArgs),
    /// Print what a shell needs to complete commands and options
    Completions(CompletionsArgs),
    /// Print a manual page
    Man(ManArgs),
    /// Show what this machine offers and what will be used
    Doctor,
}

/// Verbs of `config`.
#[derive(Debug, Subcommand)]
pub(super) enum ConfigCommand {
    /// Print every setting
    Show {
        /// Layers to merge.
        #[command(flatten)]
        settings: SettingArgs,
        /// One line a setting, with the file and line or option it comes from
        #[arg(long)]
        origin: bool,
    },
}

/// Options of `completions`.
#[derive(Args, Clone, Debug)]
#[command(
    after_help = "Example: artitwin completions bash > ~/.local/share/bash-completion/completions/artitwin"
)]
pub(super) struct CompletionsArgs {
    /// Shell that completes
    #[arg(value_name = "SHELL")]
    pub shell: Shell,
}

/// Options of `man`.
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin man reconstruct > ~/.local/share/man/man1/artitwin-reconstruct.1")]
pub(super) struct ManArgs {
    /// Command whose page is printed; without it the page of the program
    #[arg(value_name = "COMMAND")]
    pub command: Option<String>,
}

impl Command {
    /// Whether it ends without being asked to.
    pub(super) fn ends_by_itself(&self) -> bool {
        #[cfg(feature = "node")]
        if let Self::Node(_) | Self::Record(_) = self {
            return false;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;
    use config::{Config, Layers};

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    /// Long options of a command and of those below it, without `--help` and `--version`.
    fn options_below(command: &clap::Command) -> usize {
        let own =
            command.get_arguments().filter(|a| a.get_long().is_some_and(|l| l != "help" && l != "version"));
        own.count() + command.get_subcommands().map(options_below).sum::<usize>()
    }

    /// The counts of eval/house.md: 116 options and 188 settings on 2026-11-30.
    #[test]
    fn options_and_settings_stay_few() {
        let options = options_below(&Cli::command());
        let shown =
            Layers::new(&Config::default()).unwrap().resolve::<Config>().unwrap().to_lines_with_origins();
        let settings = shown.lines().count();
        assert!(options <= 100 && settings <= 126, "{options} options, {settings} settings");
    }

    #[test]
    fn options_are_parsed() {
        let parse = |line: &str| Cli::try_parse_from(line.split(' ')).map(|cli| cli.command);
        let line =
            "artitwin reconstruct bag --out runs --workspace -1,-2,-3,1,2,3 --split 4.5,6 --topic color=/a=b";
        let Ok(Command::Reconstruct(args)) = parse(line) else { panic!("{line}") };
        assert_eq!(args.recording.workspace, Some([[-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]]));
        assert_eq!(args.recording.split, [4.5, 6.0]);
        assert_eq!(args.recording.topic, [("color".to_owned(), "/a=b".to_owned())]);
        for wrong in [
            "artitwin",
            "artitwin reconstruct bag",
            "artitwin reconstruct --out runs",
            "artitwin reconstruct a b --out runs --jobs 0",
            "artitwin reconstruct a b --out runs --jobs 2 --name x",
            "artitwin reconstruct a --out runs --name ../x",
            "artitwin reconstruct a --out runs --workspace 1,2,3",
            "artitwin reconstruct a --out runs --topic color",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
