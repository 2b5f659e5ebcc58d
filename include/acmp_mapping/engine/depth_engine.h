#pragma once

#include <memory>
#include <string>

#include "acmp_mapping/engine/estimate_transfer.h"
#include "acmp_mapping/engine/fusion_engine.h"
#include "acmp_mapping/engine/matching_engine.h"

namespace acmp {

/// All that a device does. Same input, options and device: same bits. An engine is used by one thread at a time; images
/// and estimates may be shared among the engines that Share() made. Handles of another device are an InvalidInputError.
/// Every method throws InvalidInputError for bad input and ProcessingError when the device fails; after either the
/// engine can be used again. The interfaces are virtual bases, so that an engine can inherit the parts that implement
/// them.
class DepthEngine : public virtual MatchingEngine, public virtual FusionEngine, public virtual EstimateTransfer {
 public:
  /// Another engine on the same device, for another thread: the two work at the same time and share handles.
  virtual std::unique_ptr<DepthEngine> Share() = 0;

  /// Bytes of device memory that images and estimates of all sharing engines take at present; 0 on the host.
  virtual size_t DeviceBytes() const = 0;
  /// Bytes of device memory that are free for more; 0 on the host.
  virtual size_t FreeDeviceBytes() const = 0;

  /// "cpu (2 threads)", "NVIDIA H200 (cuda:0)".
  virtual std::string device_name() const = 0;
};

}  // namespace acmp
