"""Definitions of messages that the index's store of ROS 2 types lacks, as their packages have them (Humble).

Of a service or action there is one for each part: `_Request`, `_Response`, `_Goal`, `_Result`, `_Feedback`.
"""

DEFINITIONS = {
    "control_msgs/msg/JointTolerance": "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration",
    "control_msgs/msg/JointComponentTolerance": """string joint_name
uint16 component
float64 position
float64 velocity
float64 acceleration""",
    "control_msgs/msg/GripperCommand": "float64 position\nfloat64 max_effort",
    "control_msgs/action/FollowJointTrajectory_Goal": """trajectory_msgs/JointTrajectory trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory
control_msgs/JointTolerance[] path_tolerance
control_msgs/JointComponentTolerance[] component_path_tolerance
control_msgs/JointTolerance[] goal_tolerance
control_msgs/JointComponentTolerance[] component_goal_tolerance
builtin_interfaces/Duration goal_time_tolerance""",
    "control_msgs/action/FollowJointTrajectory_Result": "int32 error_code\nstring error_string",
    "control_msgs/action/FollowJointTrajectory_Feedback": """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
string[] multi_dof_joint_names
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_desired
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_actual
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error""",
    "control_msgs/action/GripperCommand_Goal": "control_msgs/GripperCommand command",
    "control_msgs/action/GripperCommand_Result": "float64 position\nfloat64 effort\nbool stalled\nbool reached_goal",
    "control_msgs/action/GripperCommand_Feedback": "float64 position\nfloat64 effort\nbool stalled\nbool reached_goal",
    "action_msgs/srv/CancelGoal_Request": "action_msgs/GoalInfo goal_info",
    "action_msgs/srv/CancelGoal_Response": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
    "std_srvs/srv/Trigger_Request": "uint8 structure_needs_at_least_one_member",
    "std_srvs/srv/Trigger_Response": "bool success\nstring message",
    "ur_msgs/msg/Digital": "uint8 pin\nbool state",
    "ur_msgs/msg/Analog": "uint8 pin\nuint8 domain\nfloat32 state",
    "ur_msgs/msg/IOStates": """ur_msgs/Digital[] digital_in_states
ur_msgs/Digital[] digital_out_states
ur_msgs/Digital[] flag_states
ur_msgs/Analog[] analog_in_states
ur_msgs/Analog[] analog_out_states""",
    "ur_msgs/srv/SetIO_Request": "int8 fun\nint8 pin\nfloat32 state",
    "ur_msgs/srv/SetIO_Response": "bool success",
    "ur_msgs/srv/SetPayload_Request": "float32 mass\ngeometry_msgs/Vector3 center_of_gravity",
    "ur_msgs/srv/SetPayload_Response": "bool success",
    "object_recognition_msgs/msg/ObjectType": "string key\nstring db",
    "octomap_msgs/msg/Octomap": "std_msgs/Header header\nbool binary\nstring id\nfloat64 resolution\nint8[] data",
    "octomap_msgs/msg/OctomapWithPose": """std_msgs/Header header
geometry_msgs/Pose origin
octomap_msgs/Octomap octomap""",
    "moveit_msgs/msg/CollisionObject": """std_msgs/Header header
geometry_msgs/Pose pose
string id
object_recognition_msgs/ObjectType type
shape_msgs/SolidPrimitive[] primitives
geometry_msgs/Pose[] primitive_poses
shape_msgs/Mesh[] meshes
geometry_msgs/Pose[] mesh_poses
shape_msgs/Plane[] planes
geometry_msgs/Pose[] plane_poses
string[] subframe_names
geometry_msgs/Pose[] subframe_poses
byte operation""",
    "moveit_msgs/msg/AttachedCollisionObject": """string link_name
moveit_msgs/CollisionObject object
string[] touch_links
trajectory_msgs/JointTrajectory detach_posture
float64 weight""",
    "moveit_msgs/msg/RobotState": """sensor_msgs/JointState joint_state
sensor_msgs/MultiDOFJointState multi_dof_joint_state
moveit_msgs/AttachedCollisionObject[] attached_collision_objects
bool is_diff""",
    "moveit_msgs/msg/AllowedCollisionEntry": "bool[] enabled",
    "moveit_msgs/msg/AllowedCollisionMatrix": """string[] entry_names
moveit_msgs/AllowedCollisionEntry[] entry_values
string[] default_entry_names
bool[] default_entry_values""",
    "moveit_msgs/msg/LinkPadding": "string link_name\nfloat64 padding",
    "moveit_msgs/msg/LinkScale": "string link_name\nfloat64 scale",
    "moveit_msgs/msg/ObjectColor": "string id\nstd_msgs/ColorRGBA color",
    "moveit_msgs/msg/PlanningSceneWorld": """moveit_msgs/CollisionObject[] collision_objects
octomap_msgs/OctomapWithPose octomap""",
    "moveit_msgs/msg/PlanningScene": """string name
moveit_msgs/RobotState robot_state
string robot_model_name
geometry_msgs/TransformStamped[] fixed_frame_transforms
moveit_msgs/AllowedCollisionMatrix allowed_collision_matrix
moveit_msgs/LinkPadding[] link_padding
moveit_msgs/LinkScale[] link_scale
moveit_msgs/ObjectColor[] object_colors
moveit_msgs/PlanningSceneWorld world
bool is_diff""",
    "moveit_msgs/msg/PlanningSceneComponents": "uint32 components",
    "moveit_msgs/srv/GetPlanningScene_Request": "moveit_msgs/PlanningSceneComponents components",
    "moveit_msgs/srv/GetPlanningScene_Response": "moveit_msgs/PlanningScene scene",
    "ur_dashboard_msgs/msg/RobotMode": "int8 mode",
    "ur_dashboard_msgs/msg/SafetyMode": "uint8 mode",
}
UUID, TIME = "unique_identifier_msgs/UUID goal_id", "builtin_interfaces/Time stamp"
OF_ACTIONS = {
    "_SendGoal_Request": UUID + "\n{action}_Goal goal",
    "_SendGoal_Response": "bool accepted\n" + TIME,
    "_GetResult_Request": UUID,
    "_GetResult_Response": "int8 status\n{action}_Result result",
    "_FeedbackMessage": UUID + "\n{action}_Feedback feedback",
}  # what rosidl makes of each action
