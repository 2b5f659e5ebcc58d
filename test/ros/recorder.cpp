#include "ros/recorder.h"

#include <optional>

#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <xmlrpcpp/XmlRpcClient.h>

namespace acmp::test {
namespace {

using XmlRpc::XmlRpcValue;

/// Whether the node with this API sends a topic to this program; none when it does not answer.
std::optional<bool> SendsHere(const std::string& uri, const std::string& topic) {
  std::string host;
  uint32_t port = 0;
  if (!ros::network::splitURI(uri, host, port)) return std::nullopt;
  XmlRpcValue request, answer;
  request[0] = ros::this_node::getName();
  XmlRpc::XmlRpcClient node(host.c_str(), static_cast<int>(port), "/");
  if (!node.execute("getBusInfo", request, answer) || node.isFault()) return std::nullopt;
  XmlRpcValue& connections = answer[2];  // id, node, direction, transport, topic, ...
  for (int i = 0; i < connections.size(); ++i) {
    XmlRpcValue& one = connections[i];
    if (std::string(one[1]) == ros::this_node::getName() && std::string(one[2]) == "o" &&
        std::string(one[4]) == topic) {
      return true;
    }
  }
  return false;
}

}  // namespace

bool IsSentByAll(const std::string& topic) {
  XmlRpcValue request, answer, state;
  request[0] = ros::this_node::getName();
  if (!ros::master::execute("getSystemState", request, answer, state, false)) return false;
  XmlRpcValue& publications = state[0];  // topic, nodes
  int senders = 0;
  for (int i = 0; i < publications.size(); ++i) {
    if (std::string(publications[i][0]) != topic) continue;
    XmlRpcValue& nodes = publications[i][1];
    for (int k = 0; k < nodes.size(); ++k) {
      XmlRpcValue uri;
      request[1] = nodes[k];
      if (!ros::master::execute("lookupNode", request, answer, uri, false)) continue;
      const std::optional<bool> sends = SendsHere(uri, topic);
      if (sends && !*sends) return false;
      senders += sends ? 1 : 0;
    }
  }
  return senders > 0;
}

}  // namespace acmp::test
