//! Options on known facts of actuators.

use super::wanted::Wanted;
use gap::record::command::{EffortUnit, ToldServo};

fn positive_number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0)
}

/// `--effort-unit`.
pub(super) fn effort_unit(text: &str) -> Result<EffortUnit, Wanted> {
    match (text, text.trim().parse::<f64>()) {
        ("unknown", _) => Ok(EffortUnit::Unknown),
        (_, Ok(1.0)) => Ok(EffortUnit::Calibrated),
        // A negative one turns the sign.
        (_, Ok(factor)) if factor.is_finite() && factor != 0.0 => Ok(EffortUnit::Factor(factor)),
        _ => Err(Wanted("a factor other than 0, such as 0.0024 for milliamperes, or `unknown`")),
    }
}

/// `--servo`.
pub(super) fn servo(text: &str) -> Result<ToldServo, Wanted> {
    const WANTED: Wanted =
        Wanted("[JOINT:]KEY=VALUE,... with the keys kp, kd, limit, delay and numbers above 0");
    let (joint, pairs) = match text.split_once(':') {
        Some((joint, pairs)) => (Some(joint.to_owned()), pairs),
        None => (None, text),
    };
    let mut servo = ToldServo { joint, ..ToldServo::default() };
    for pair in pairs.split(',').filter(|p| !p.trim().is_empty()) {
        let (key, value) = pair.split_once('=').ok_or(WANTED)?;
        // A damping or a delay of 0 means none.
        let is_zero = value.trim().parse() == Ok(0.0);
        let value = positive_number(value).or_else(|| is_zero.then_some(0.0));
        match (key.trim(), value) {
            ("kp", Some(x)) if x > 0.0 => servo.stiffness = Some(x),
            ("limit", Some(x)) if x > 0.0 => servo.limit = Some(x),
            ("kd", Some(x)) => servo.damping = Some(x),
            ("delay", Some(x)) => servo.delay_s = Some(x),
            _ => return Err(WANTED),
        }
    }
    Ok(servo)
}

/// `--command`.
pub(super) fn command_topic(text: &str) -> Result<(String, Vec<String>), Wanted> {
    let (topic, joints) = text.split_once('=').unwrap_or((text, ""));
    let joints: Vec<String> = joints.split(',').filter(|j| !j.is_empty()).map(str::to_owned).collect();
    if topic.is_empty() {
        return Err(Wanted("TOPIC, or TOPIC=JOINT,... for values without names"));
    }
    Ok((topic.to_owned(), joints))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_of_a_servo_is_read_and_nonsense_refused() {
        let told = servo("lid:kp=20,kd=0,limit=3").unwrap();
        assert_eq!(
            (told.joint.as_deref(), told.stiffness, told.damping),
            (Some("lid"), Some(20.0), Some(0.0))
        );
        assert_eq!((told.limit, told.delay_s), (Some(3.0), None));
        assert_eq!(servo("").unwrap(), ToldServo::default());
        for wrong in ["kp", "kp=0", "kp=-1", "kp=nan", "gain=3", "limit=0"] {
            assert!(servo(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_unit_is_a_factor_or_unknown() {
        assert_eq!(effort_unit("1").unwrap(), EffortUnit::Calibrated);
        assert_eq!(effort_unit("-0.5").unwrap(), EffortUnit::Factor(-0.5));
        assert_eq!(effort_unit("unknown").unwrap(), EffortUnit::Unknown);
        assert!(effort_unit("0").is_err() && effort_unit("inf").is_err() && effort_unit("mA").is_err());
    }

    #[test]
    fn a_command_may_tell_the_joints_of_its_values() {
        assert_eq!(command_topic("/c=a,b").unwrap(), ("/c".into(), vec!["a".into(), "b".into()]));
        assert_eq!(command_topic("/c").unwrap(), ("/c".into(), Vec::new()));
        assert!(command_topic("=a").is_err());
    }
}
