# SPDX-License-Identifier: Apache-2.0
"""Words of other programs and papers for what this package calls otherwise.

Only messages use them: a wrong name is refused with the one that is meant here.
"""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ['same_meaning']

# One line for each thing; of those words that a message is about, it proposes the known ones.
_SAME = tuple(tuple(line.split()) for line in """
q positions position pos joint_positions joint_angles angles angle
qd velocities velocity vel dq qdot q_dot joint_velocities speed
qdd accelerations acceleration acc ddq qddot q_ddot
tau torque torques effort efforts u control input action command commands joint_torques measured
t time times timestamps timestamp
e1 e error errors tracking_error tracking_errors position_error
e2 velocity_error
test_rmse train_rmse rmse rms error errors residual residuals accuracy score fit mse test_error
estimate theta_dict as_dict to_dict by_name
theta theta_hat estimate estimates params values coefficients coef coef_ solution thetahat
estimate parameters params parameter_names names labels theta_names
joints joint_names names base_link tip end_effector chain
n dof dofs ndof n_dof num_joints n_joints nq nv
m n_params num_params n_parameters num_parameters np
true_parameters theta_star theta_true true_theta theta ground_truth
nominal theta0 theta_0 params values
nominal theta_star theta_true true_parameters true_theta ground_truth
joints joint_names names labels
rank history_rank
std stds standard_deviation standard_deviations sigma standard_errors stderr uncertainties
consistent model physical feasible
urdf to_urdf export export_urdf save_urdf write_urdf
kept ok success safe violations is_safe inside valid
wall_s runtime elapsed wall_time
figures summary stats statistics metrics results report info
identifier estimator learner model
update_law law adaptation_law rls forgetting forgetting_factor kalman method algorithm solver
margins is_safe inside safe margin distance
lyapunov barrier V energy
check_start check
payload payload_mass load load_mass
controller law ctrl policy
reference desired trajectory target setpoint yd y_d q_des q_ref q_desired q_d ref goal waypoints
stack history buffer memory
undetermined unidentifiable undetermined_parameters missing
prediction predicted predictions
predicted measured tau torque torques
predict prediction predict_torque predict_torques inverse_dynamics id rnea
update step compute control act call run compute_torque get_torque
learn fit train identify learn_from
dynamics forward_dynamics simulate simulator fd
acceleration forward_dynamics qdd fd aba
advance step integrate simulate
Y regressor phi regressor_matrix
mass_matrix M inertia inertia_matrix crba
link_points fk forward_kinematics kinematics fkine tip_position
initial_estimate theta theta_hat
initial_estimate initial theta0 theta_0 initial_guess initial_theta theta_init initial_parameters
initial_estimate regularization regularisation ridge
start q0 q_0 initial_position initial_posture x0 start_position
initial_position start q0 q_0 initial_posture x0 start_position
velocity qd0 initial_velocity v0
duration time t_end tf t_final seconds length horizon T
period dt ts step timestep time_step sample_time
rate frequency hz fs sample_rate sampling_rate dt ts timestep time_step sample_time period
amplitude amp amplitudes
frequency omega w frequencies
retune set_parameters set_params set_parameter set update_settings set_gains set_settings
settings get_parameters get_params get_settings params config params_file config_file yaml
gamma learning_rate lr adaptation_gain adaptation_gains gain
k1 kp p_gain
k2 kd d_gain
torque_limit max_torque tau_max torque_limits effort_limit u_max
torque_noise effort_noise tau_noise noise sensor_noise measurement_noise
encoder_counts position_noise velocity_noise q_noise
encoder_counts encoder encoders counts ticks cpr noise sensor_noise measurement_noise
size P history_size stack_size buffer_size memory
safety bounds limits joint_limits position_limits safety_set
performance error_bounds error_limits tolerance performance_set
true_parameters viscous friction damping
viscous coulomb offset square_root friction damping
viscous friction_viscous
coulomb friction_coulomb dry static_friction
offset friction_offset bias
square_root friction_square_root
rotor_inertia armature
columns cols fields mapping
degrees deg in_degrees unit units
train train_span training train_time train_size train_fraction split
test test_span testing test_size test_fraction validation
validate validation validation_log test_log
urdf path file filename model robot xml robot_description description
arm robot model
plant robot env environment simulator system
observer callback hook on_sample
bag save save_to output out record
save to_csv to_file dump write store to_npz to_yaml to_json export
time_constant cutoff bandwidth tau_filter
progress verbose
position_lower lower q_min qmin lower_limit lower_limits position_limits joint_limits limits
position_upper upper q_max qmax upper_limit upper_limits position_limits joint_limits limits
velocity_limit velocity_limits max_velocity qd_max
lower min low minimum lb
upper max high maximum ub
load_arm load_urdf from_urdf urdf load_robot robot load load_model
read_log read_csv load_csv load_log read_data load open
read_bag load_bag open_bag bag
simulate sim simulation run_simulation run play compare
run simulate
Identifier Estimator AdaptiveIdentifier learner fit
Controller AdaptiveController BLFController control
TwoLinkArm TwoLink two_link
ThreeLinkArm ThreeLink three_link
""".strip().splitlines())


def same_meaning(name: str, known: Iterable[str]) -> list[str]:
    """Return the known names that mean what ``name`` may mean, the likeliest first.

    Args:
        name: What was written.
        known: Dotted names; the last part of one counts, and those with fewer parts come first.
    """
    typed = {name, name.lower(), name.lower().removesuffix('s'), f'{name.lower()}s'}
    meanings = [words for words in _SAME if typed & set(words)]
    by_end: dict[str, list[str]] = {}
    for other in known:
        by_end.setdefault(other.rpartition('.')[2], []).append(other)
    found = [other for words in meanings for word in words for other in by_end.get(word, ())
             if other != name]
    return sorted(dict.fromkeys(found), key=lambda other: other.count('.'))
