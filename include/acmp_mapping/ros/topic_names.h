#pragma once

/// Names relative to the node's namespace (topics) or private to it (services); all can be remapped. Those of poses are
/// in pose_sources.h.
namespace acmp::names {

constexpr char kImage[] = "image";
constexpr char kCompressed[] = "/compressed";  ///< after the name of an image's topic
constexpr char kCameraInfo[] = "camera_info";
constexpr char kTf[] = "/tf";
constexpr char kTfStatic[] = "/tf_static";
constexpr char kExtrinsic[] = "extrinsic";
constexpr char kSparsePoints[] = "sparse_points";
constexpr char kSparsePointsV1[] = "sparse_points_v1";
constexpr char kKeyframe[] = "keyframe";
constexpr char kMask[] = "mask";
constexpr char kPriorDepth[] = "prior_depth";
constexpr char kLabels[] = "labels";
// Of the first source camera and of the others.
constexpr const char* kSourceImages[] = {"source_image", "source_image_2", "source_image_3", "source_image_4"};
constexpr const char* kSourceCameraInfos[] = {"source_camera_info", "source_camera_info_2", "source_camera_info_3",
                                              "source_camera_info_4"};
constexpr char kOptimizedPath[] = "optimized_path";
constexpr char kDefaultTopics[] = "/slam/";  ///< before these names: where our launch files and recordings have them

constexpr char kFacePrefix[] = "face_";  ///< of the image topics of a wide image's faces: face_left/depth/...
constexpr char kDepthFast[] = "depth_fast/image_rect";
constexpr char kDepth[] = "depth/image_rect";
constexpr char kDepthCameraInfo[] = "depth/camera_info";
constexpr char kDepthMillimetres[] = "depth/image_raw";
constexpr char kDepthPicture[] = "depth/image_vis";
constexpr char kColor[] = "rgb/image_rect_color";
constexpr char kConfidence[] = "confidence/image";
constexpr char kConfidencePicture[] = "confidence/image_vis";
constexpr char kNormal[] = "normal/image";
constexpr char kNormalPicture[] = "normal/image_vis";
constexpr char kPoints[] = "points";
constexpr char kMapPoints[] = "map_points";
constexpr char kMapLabels[] = "map_labels";
constexpr char kOccupancy[] = "occupancy";
constexpr char kMesh[] = "mesh";
constexpr char kDistanceSlice[] = "distance_slice";
constexpr char kDistanceChange[] = "distance_change";
constexpr char kKeyframePose[] = "keyframe_pose";
constexpr char kKeyframePath[] = "keyframe_path";
constexpr char kKeyframeDepth[] = "keyframe_depth";
constexpr char kKeyframePoints[] = "keyframe_points";

constexpr char kSaveMap[] = "save_map";
constexpr char kSaveSession[] = "save_session";
constexpr char kLoadSession[] = "load_session";
constexpr char kGetDistances[] = "get_distances";
constexpr char kReset[] = "reset";
constexpr char kFlush[] = "flush";
constexpr char kPublishMap[] = "publish_map";
constexpr char kPause[] = "pause";

}  // namespace acmp::names
