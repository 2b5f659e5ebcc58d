#include "acmp_mapping/ros/nodelet_base.h"

#include <exception>

namespace acmp {

void NodeletBase::onInit() {
  try {
    Start();
    for (CallbackThread* thread : {&input_thread_, &service_thread_, &urgent_thread_, &status_thread_}) thread->Start();
  } catch (const std::exception& error) {
    NODELET_FATAL("cannot start: %s", error.what());
    throw;
  }
}

ParameterReader NodeletBase::ReadParameters() {
  XmlRpc::XmlRpcValue values;
  getPrivateNodeHandle().getParam(getPrivateNodeHandle().getNamespace(), values);
  ParameterReader reader(values);
  reader.Allow("num_worker_threads");  // a nodelet manager of the same name
  return reader;
}

void NodeletBase::WarnOfUnknown(const ParameterReader& reader) {
  for (const std::string& warning : reader.DescribeUnknown()) NODELET_WARN("%s", warning.c_str());
}

void NodeletBase::Report(RejectedInput rejected) {
  rejected.message = Printable(rejected.message);
  if (incidents_.Record(rejected, SteadySeconds())) {
    NODELET_WARN("%s: %s", rejected.reason.c_str(), rejected.message.c_str());
  }
}

void NodeletBase::StopThreads() {
  input_thread_.Stop();
  service_thread_.Stop();
  urgent_thread_.Stop();
  status_thread_.Stop();
  services_.clear();
}

}  // namespace acmp
