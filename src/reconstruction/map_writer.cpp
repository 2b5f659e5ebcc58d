#include "map_writer.h"

#include <memory>
#include <mutex>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "view_outputs.h"

namespace acmp {

MapWriter::MapWriter(ReconstructRun* run)
    : run_(*run),
      files_(run),
      measures_confidence_(files_.HasConfidence() && !run->options.online()) {}  // online maps come with theirs

int MapWriter::AddTasks(const ImagePlan& image, std::vector<int> after, TaskGraph* graph) {
  if (measures_confidence_) {
    after = {AddConfidence(&run_, image, after, graph, [this, index = image.index](ConfidenceMap confidence) {
      const std::lock_guard<std::mutex> lock(run_.times_mutex);
      confidences_[index] = std::move(confidence);
    })};
  }
  return graph->Add(Devices::kFilePool, after, [this, &image](int) { WriteFiles(image.index); });
}

void MapWriter::WriteFiles(int index) {
  if (files_.any()) {
    const std::shared_ptr<const FinalMaps> maps = run_.store.Final(index);
    const ConfidenceMap measured = TakeConfidence(index);
    Timer timer;
    const size_t too_far = files_.Write(index, *maps, measures_confidence_ ? measured : maps->confidence);
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    too_far_ += too_far;
    run_.times.writing_ms += timer.Lap();
  }
  run_.store.ReleaseFinal(index);
  run_.progress.Step();
}

/// Empty if none was measured.
ConfidenceMap MapWriter::TakeConfidence(int index) {
  const std::lock_guard<std::mutex> lock(run_.times_mutex);
  const auto measured = confidences_.extract(index);
  return measured ? std::move(measured.mapped()) : ConfidenceMap();
}

void MapWriter::WarnOfDepthsTooFar() const {
  if (too_far_ == 0) return;
  run_.progress.Warn(
      Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
}

}  // namespace acmp
