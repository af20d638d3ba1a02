//! ROS 2's services about a node's parameters and log level, and the topic of their changes.

use std::sync::Arc;

use super::{
    clock::NodeClock,
    error::NodeError,
    live_parameters::LiveParameters,
    logger,
    parameter_messages::{
        DescribeParametersRequest, DescribeParametersResponse, GetLoggerLevelsRequest,
        GetParameterTypesRequest, GetParameterTypesResponse, GetParametersRequest, GetParametersResponse,
        ListParametersRequest, ListParametersResponse, ListParametersResult, LoggerLevel, LoggerLevels,
        Parameter, ParameterEvent, SetLoggerLevelsResponse, SetParametersAtomicallyResponse,
        SetParametersRequest, SetParametersResponse, SetParametersResult,
    },
    participant::{Participant, Publisher, reliable_profile},
    services::serve_requests,
};

/// Queue length of `/parameter_events`.
/// derived: that of rmw_qos_profile_parameter_events
const EVENTS: usize = 1000;
/// Names that one request is answered for.
/// chosen: a node of ROS 2 has tens of parameters; a flood of names makes no larger answer
const MOST_NAMES: usize = 1000;

/// What the services need.
struct ParameterServer {
    parameters: Arc<LiveParameters>,
    clock: Arc<NodeClock>,
    node: String,
    events: Publisher<ParameterEvent>,
}

/// Offers the services.
///
/// # Errors
/// If the network reports an error.
pub(crate) fn offer_parameters(
    participant: &mut Participant,
    parameters: &Arc<LiveParameters>,
    clock: &Arc<NodeClock>,
) -> Result<(), NodeError> {
    let node = participant.identity.fully_qualified_name();
    let event_type = "rcl_interfaces/msg/ParameterEvent";
    let events =
        participant.create_publisher_of_type("/parameter_events", event_type, &reliable_profile(EVENTS))?;
    let clock = Arc::clone(clock);
    let server = Arc::new(ParameterServer { parameters: Arc::clone(parameters), clock, node, events });
    offer_reading(participant, parameters)?;
    let this = Arc::clone(&server);
    serve_requests(
        participant,
        "~/set_parameters",
        "rcl_interfaces/srv/SetParameters",
        move |request: SetParametersRequest| {
            let this = Arc::clone(&this);
            async move { this.set_each(&request.parameter).await }
        },
    )?;
    serve_requests(
        participant,
        "~/set_parameters_atomically",
        "rcl_interfaces/srv/SetParametersAtomically",
        move |request: SetParametersRequest| {
            let this = Arc::clone(&server);
            async move { SetParametersAtomicallyResponse { result: this.set_all(&request.parameter).await } }
        },
    )?;
    offer_log_level(participant)
}

/// Offers the services that change nothing.
fn offer_reading(participant: &mut Participant, parameters: &Arc<LiveParameters>) -> Result<(), NodeError> {
    let live = Arc::clone(parameters);
    serve_requests(
        participant,
        "~/get_parameters",
        "rcl_interfaces/srv/GetParameters",
        move |request: GetParametersRequest| {
            let names = request.names.iter().take(MOST_NAMES);
            let values = names.map(|n| live.value(n)).collect();
            async { GetParametersResponse { values } }
        },
    )?;
    let live = Arc::clone(parameters);
    serve_requests(
        participant,
        "~/get_parameter_types",
        "rcl_interfaces/srv/GetParameterTypes",
        move |request: GetParameterTypesRequest| {
            let names = request.names.iter().take(MOST_NAMES);
            let values = names.map(|n| live.value(n).ptype).collect();
            async { GetParameterTypesResponse { values } }
        },
    )?;
    let live = Arc::clone(parameters);
    serve_requests(
        participant,
        "~/describe_parameters",
        "rcl_interfaces/srv/DescribeParameters",
        move |request: DescribeParametersRequest| {
            let names = request.names.iter().take(MOST_NAMES);
            let values = names.map(|n| live.descriptor(n)).collect();
            async { DescribeParametersResponse { values } }
        },
    )?;
    let live = Arc::clone(parameters);
    serve_requests(
        participant,
        "~/list_parameters",
        "rcl_interfaces/srv/ListParameters",
        move |request: ListParametersRequest| {
            // No name has a prefix, so that a prefix is the name itself.
            let is_asked = |n: &String| request.prefixes.is_empty() || request.prefixes.contains(n);
            let names = live.names().into_iter().filter(is_asked).collect();
            let result = ListParametersResult { names, prefixes: Vec::new() };
            async { ListParametersResponse { result } }
        },
    )
}

/// Offers the services about the log level, as nodes with `enable_logger_service` do.
fn offer_log_level(participant: &mut Participant) -> Result<(), NodeError> {
    serve_requests(
        participant,
        "~/get_logger_levels",
        "rcl_interfaces/srv/GetLoggerLevels",
        |request: GetLoggerLevelsRequest| {
            let names = request.names.into_iter().take(MOST_NAMES);
            let levels =
                names.map(|name| LoggerLevel { level: logger::level_of_logger(&name), name }).collect();
            async { LoggerLevels { levels } }
        },
    )?;
    serve_requests(
        participant,
        "~/set_logger_levels",
        "rcl_interfaces/srv/SetLoggerLevels",
        |request: LoggerLevels| {
            let levels = request.levels.iter().take(MOST_NAMES);
            let results =
                levels.map(|l| SetParametersResult::from(logger::set_level(&l.name, l.level))).collect();
            async { SetLoggerLevelsResponse { results } }
        },
    )
}

impl ParameterServer {
    async fn set_each(&self, asked: &[Parameter]) -> SetParametersResponse {
        let mut results = Vec::new();
        for parameter in asked.iter().take(MOST_NAMES) {
            results.push(self.set_all(std::slice::from_ref(parameter)).await);
        }
        SetParametersResponse { results }
    }

    /// Sets all parameters or none, and publishes those that changed.
    async fn set_all(&self, asked: &[Parameter]) -> SetParametersResult {
        match self.parameters.set_all(asked) {
            Ok(changed) => {
                self.publish_changes(changed).await;
                SetParametersResult::from(Ok(()))
            }
            Err(reason) => SetParametersResult::from(Err(reason)),
        }
    }

    async fn publish_changes(&self, changed_parameters: Vec<Parameter>) {
        if changed_parameters.is_empty() {
            return;
        }
        let names: Vec<&str> = changed_parameters.iter().map(|p| p.name.as_str()).collect();
        log::info!("set: {}", names.join(", "));
        let event = ParameterEvent {
            stamp: self.clock.message_stamp_now(),
            node: self.node.clone(),
            new_parameters: Vec::new(),
            changed_parameters,
            deleted_parameters: Vec::new(),
        };
        if self.events.async_publish(event).await.is_err() {
            log::debug!("/parameter_events could not be published");
        }
    }
}
