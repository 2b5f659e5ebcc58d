#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

struct InputMatcherOptions {
  double sync_tolerance_s = 1e-3;    ///< between the stamps of image and pose, 0..10
  double sparse_wait_s = 0.1;        ///< an image with a pose waits so long (wall time) for its own cloud, 0..10
  double mask_wait_s = 0.5;          ///< and so long for its mask, prior depth, labels and source images, 0..10
  int image_capacity = 30;           ///< images that wait for their pose, 1..1000
  int source_cameras = 0;            ///< 0..kMaxSourceCameras
  double source_tolerance_s = 5e-3;  ///< between the stamps of an image and those of source cameras, 0..0.1
};
constexpr int kMaxSourceCameras = 4;  ///< that bring source images beside the mapper's own

/// Streams of what belongs to images and is an image itself: each image waits for its own (~mask_wait).
enum CompanionStream : size_t {
  kMaskStream,
  kPriorDepthStream,
  kLabelStream,
  kSourceStream
};  ///< the last: of source camera 0, the others follow

/// An image with its pose and landmarks.
struct MatchedInput {
  ImageSample image;
  PoseSample pose;
  SparseCloudPtr cloud;                  ///< may be null
  std::optional<PoseSample> cloud_pose;  ///< pose at the cloud's stamp; needed where clouds are in the camera's frame
  /// Of each CompanionStream the one that belongs to the image; null where none came in time.
  std::vector<std::shared_ptr<const EncodedImage>> companions;
};

/// The images' stamps went back (a bag that loops, a restarted camera): everything before belongs to another run.
struct TimeJump {
  int64_t from_ns = 0;
  int64_t to_ns = 0;
};

using MatchEvent = std::variant<MatchedInput, TimeJump, RejectedInput>;

/// How far the nearest pose was from the last image that found none.
struct PoseGap {
  int64_t image_stamp_ns = 0;
  std::optional<int64_t> gap_ns;  ///< pose minus image; none when there was no pose at all
  std::string problem;            ///< what a source that is asked for poses said; else empty
};

/// Where the poses of images come from, as far as their source tells stamps (tf does not).
struct PoseUse {
  uint64_t same = 0, between = 0, nearest = 0;  ///< images with the pose of their stamp, between two, with the nearest
  int64_t farthest_ns = 0;                      ///< of those of the latter two, from the nearest pose
};

/// Streams whose stamps go back by less brought them in the wrong order; by more, they belong to another run.
constexpr int64_t kTimeJumpNs = 200000000;
constexpr int64_t kSameExposureNs = 1000000;  ///< rounding of stamps stays far below, the shortest frame interval above

/// What has come of one stream, in order of arrival: poses, clouds, masks, images of other cameras. When time jumps
/// back (a bag that loops, a restarted frontend), the stamps of every stream do, but between streams there is no order:
/// a message of the new run may come before the image that shows the jump, and one of the old run after it.
template <class Sample>
class StreamBuffer {
 public:
  struct Received {
    int64_t stamp_ns;
    Sample sample;
    bool used = false;  ///< a pose belongs to one image
  };

  /// @param capacity of those that came first, more are forgotten
  void Add(int64_t stamp_ns, Sample sample, size_t capacity) {
    if (left_newest_ns_ && stamp_ns < *left_newest_ns_ - kTimeJumpNs) {
      received.clear();
      left_newest_ns_.reset();
    } else if (left_newest_ns_) {
      left_newest_ns_ = std::max(*left_newest_ns_, stamp_ns);
    }
    received.push_back({stamp_ns, std::move(sample)});
    if (received.size() > capacity) received.pop_front();
  }

  /// What has come with a stamp, in this run; null: nothing.
  const Received* Find(int64_t stamp_ns) const {
    for (auto r = received.rbegin(); r != received.rend() && r->stamp_ns >= stamp_ns; ++r) {
      if (r->stamp_ns > stamp_ns + kTimeJumpNs) break;  // of the run before
      if (r->stamp_ns == stamp_ns) return &*r;
    }
    return nullptr;
  }

  /// Whether one of these stamps or a later one has come. A stamp that the stream has left far behind again, as it was
  /// of the future, tells nothing.
  /// @param latest_ns holds for the first image of a run: what came late of the run before tells nothing of it
  bool HasComeFrom(int64_t earliest_ns, int64_t latest_ns = INT64_MAX, bool is_first = false) const {
    if (!(is_first && is_behind())) latest_ns = INT64_MAX;
    int64_t later_ns = INT64_MAX;  // the earliest of those that came after
    for (auto r = received.rbegin(); r != received.rend(); ++r) {
      const bool is_wanted = r->stamp_ns >= earliest_ns && r->stamp_ns <= latest_ns;
      if (is_wanted && r->stamp_ns - kTimeJumpNs <= later_ns) return true;
      later_ns = std::min(later_ns, r->stamp_ns);
    }
    return false;
  }

  /// The images' stamps went back, to this one. Leaves what has come since this stream's did.
  void StartRun(int64_t first_image_ns) {
    int64_t newest_ns = INT64_MIN / 2, before_jump_ns = newest_ns;
    size_t first = received.size();
    for (size_t i = 0; i < received.size(); ++i) {
      const int64_t stamp_ns = received[i].stamp_ns;
      if (stamp_ns < newest_ns - kTimeJumpNs) {
        first = i;
        before_jump_ns = std::exchange(newest_ns, stamp_ns);
      }
      newest_ns = std::max(newest_ns, stamp_ns);
      // Beyond where it was without the images having gone back: a message that came late, or poses that were sent
      // again. A short bag that loops may bring all of a stream before the first image, up to the very stamp.
      if (newest_ns > before_jump_ns) first = received.size();
    }
    left_newest_ns_.reset();
    // A stream that had not got so far goes on without a jump.
    if (first == received.size() && newest_ns - kTimeJumpNs > first_image_ns) left_newest_ns_ = newest_ns;
    received.erase(received.begin(), received.begin() + static_cast<std::ptrdiff_t>(first));
  }

  /// Whether the images' stamps have gone back and this stream's must and have not yet: what comes may be of the run
  /// before. A stream that is stamped by another clock may stay so.
  bool is_behind() const { return left_newest_ns_.has_value(); }

  std::deque<Received> received;

 private:
  std::optional<int64_t> left_newest_ns_;  ///< while behind: newest stamp of the run that the images have left
};

/// Matches images, poses and sparse clouds by stamp in ring buffers of its own. Real frontends push stamps through
/// doubles, publish a pose one or more images late and stamp clouds with the time of sending, so neither equal stamps
/// nor any order between the streams is assumed; only poses among themselves come in order. Not thread-safe.
///
/// An image takes the pose of its stamp (kSameExposureNs), else that between the poses before and after it where both
/// are within the tolerance, else the nearest within. A pose earlier than the image by more than kSameExposureNs is
/// taken only once a later one has come. A mask, prior depth or labels belong to the image of its stamp, rounding
/// aside, a source camera's image to that within its tolerance, and is not waited for once one of a later image has
/// come. Matches come out in the order of the images' stamps; images that were overtaken by a match are dropped, since
/// frontends need not give every image a pose.
class InputMatcher {
 public:
  explicit InputMatcher(const InputMatcherOptions& options);

  void AddImage(ImageSample image);
  void AddPose(PoseSample pose);
  void AddCloud(SparseCloudPtr cloud);
  /// @param stream a CompanionStream, up to that of the last source camera
  void AddCompanion(size_t stream, ImageSample sample);

  /// Whether anybody publishes clouds; if not, no image waits for one. True at first.
  void set_clouds_expected(bool expected) { clouds_expected_ = expected; }
  /// The same of a CompanionStream; false at first. While set, an image that goes without is told by a RejectedInput.
  void set_companion_expected(size_t stream, bool expected) { companions_.at(stream).expected = expected; }
  /// While set, images wait; those that wait too long are dropped with this. Set at first: no camera is known.
  void set_obstacle(std::optional<RejectedInput> obstacle) { obstacle_ = std::move(obstacle); }

  /// Stamps of the images that have no pose yet, oldest first, for sources that are asked for poses (tf).
  std::vector<int64_t> UnposedStamps() const;
  /// Why such a source has none for this image: told when the image is dropped.
  void SetPoseProblem(int64_t stamp_ns, const std::string& problem);

  /// What has happened since the last call, in order. `now_s` is any clock that never goes back.
  std::vector<MatchEvent> Take(double now_s);

  /// The same without waiting for clouds, masks and prior depth any longer.
  std::vector<MatchEvent> TakeAll();

  /// Forgets everything received; images that waited are reported as dropped for `reason`.
  void Clear(const std::string& reason);

  const std::optional<RejectedInput>& obstacle() const { return obstacle_; }
  /// The oldest image that has no pose, and what keeps it from one; none where all have one.
  struct PoseWait {
    double arrival_s;  ///< of the image
    std::string message;
  };
  std::optional<PoseWait> longest_pose_wait() const;
  size_t waiting_images() const { return images_.size(); }
  const std::optional<PoseGap>& last_gap() const { return last_gap_; }
  const PoseUse& pose_use() const { return pose_use_; }

 private:
  struct WaitingImage {
    ImageSample sample;
    std::optional<PoseSample> pose = {};
    double ready_since_s = -1;      ///< when the pose was found; < 0: not yet
    std::string pose_problem = {};  ///< what SetPoseProblem told
    bool is_searched = false;       ///< for poses, of which one is within the tolerance:
    bool has_near_pose = false;
  };
  /// A CompanionStream.
  struct Companions {
    int64_t tolerance_ns = kSameExposureNs;  ///< between the stamps of what belongs together
    bool expected = false;                   ///< somebody publishes them
    StreamBuffer<ImageSample> buffer = {};
  };

  void HandleTimeJump(int64_t stamp_ns);
  void EvictOldestImage();
  void FindPoses(double now_s);
  /// Of an image; none yet, or at all. Marks the one that is used.
  std::optional<PoseSample> FindPose(int64_t stamp_ns);
  /// Between those before and after, if both are within the tolerance.
  std::optional<PoseSample> PoseBetween(int64_t stamp_ns) const;
  bool PoseIsFinal(int64_t image_stamp_ns, int64_t pose_stamp_ns) const;
  void EmitReady(double now_s, bool wait);
  bool CloudIsSettled(const WaitingImage& image, double now_s) const;
  SparseCloudPtr ChooseCloud(int64_t stamp_ns) const;
  bool CompanionsAreSettled(const WaitingImage& image, double now_s) const;
  RejectedInput DescribeMissingCompanion(size_t stream, int64_t stamp_ns) const;
  /// Clouds, masks and depth maps that are kept: an image that waits for its pose must find its own when that comes.
  size_t CompanionCapacity() const;
  void Emit(WaitingImage image);
  void DropUnposed(const WaitingImage& image);
  void DropWaiting(const WaitingImage& image);
  /// How far the nearest pose is from a stamp; none where no pose has come.
  std::optional<int64_t> PoseGapOf(int64_t stamp_ns) const;
  std::string DescribeMissingPose(const WaitingImage& image) const;

  InputMatcherOptions options_;
  int64_t sync_tolerance_ns_;
  bool clouds_expected_ = true;
  std::optional<RejectedInput> obstacle_ = RejectedInput{"no_camera_info", "no usable camera_info has been received"};

  std::deque<WaitingImage> images_;  ///< ascending stamps
  StreamBuffer<PoseSample> poses_;
  std::vector<int64_t> new_poses_ns_;  ///< stamps of those that no image has been searched for
  StreamBuffer<SparseCloudPtr> clouds_;
  std::vector<Companions> companions_;  ///< by CompanionStream
  std::vector<MatchEvent> events_;
  std::optional<int64_t> newest_image_ns_;
  std::optional<int64_t> last_match_ns_;
  std::optional<PoseGap> last_gap_;
  PoseUse pose_use_;
};

}  // namespace acmp
